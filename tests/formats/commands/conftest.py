import json

import pytest
from click.testing import CliRunner

from elvis.plugins.command.command import elvis as group


@pytest.fixture
def elvis():
    """Run a command in this process and return what it printed; failures come out as they are."""

    def run(*arguments):
        outcome = CliRunner().invoke(group, [str(argument) for argument in arguments], standalone_mode=False)
        if outcome.exception:
            raise outcome.exception
        return outcome.stdout

    return run


@pytest.fixture
def elvis_json(elvis):
    """As ``elvis``, what is printed parsed as strict JSON."""

    def refuse(constant):
        raise ValueError(constant)

    return lambda *arguments: json.loads(elvis(*arguments, "--json"), parse_constant=refuse)
