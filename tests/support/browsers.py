"""The browser that tests of pages run."""

import shutil

import pytest

#: programs that can be it; the first has no window and takes a third of the second's processor time for a page
BROWSERS = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")


def find_browser() -> str:
    """The path of the first of `BROWSERS` that is here; the test is skipped where there is none."""
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        pytest.skip(f"needs a browser: {' or '.join(BROWSERS)}")
    return found
