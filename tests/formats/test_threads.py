"""Work that threads share."""

import threading

import pytest

from elvis.core.base.threads import Once, results


def test_results_come_in_the_order_of_the_jobs():
    """Also where there are none, or one."""
    assert list(results(iter([]))) == []
    assert list(results([lambda own=own: own**2 for own in range(20)])) == [own**2 for own in range(20)]


def test_a_single_job_starts_no_thread():
    assert list(results([threading.get_ident])) == [threading.get_ident()]


def test_the_first_failure_is_raised():
    """After the results before it."""
    found, jobs = [], [lambda: 1, lambda: [][0], lambda: 1 / 0]
    with pytest.raises(IndexError):
        found.extend(results(jobs))
    assert found == [1]


def test_started_work_runs_meanwhile():
    begun, once = threading.Event(), Once()
    with once.started(lambda: begun.set() or 7) as result:
        assert begun.wait(5)
        assert result() == 7
    with once.started(lambda: pytest.fail("done again")) as result:
        assert result() == 7


def test_failed_work_is_retried():
    once = Once()
    with once.started(lambda: 1 / 0) as result, pytest.raises(ZeroDivisionError):
        result()
    with once.started(lambda: 7) as result:
        assert result() == 7
