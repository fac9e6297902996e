"""The picture of a report for the first page: `python examples/reports/shoot.py [NAME [PICTURE]]`.

Opens out/reports/NAME/index.html, which make.py has written, in a headless Chromium, and keeps what a wide window shows
of it in docs/report.png.  By default NAME is twist.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
#: width and height of the window in pixels; colours that are retained
WINDOW, COLORS = (1280, 1150), 192


def main(arguments: list[str]) -> int:
    """Write the picture; 2 for a wrong command line, 1 where the report or the browser is missing."""
    if len(arguments) > 2:
        print("expected the name of a case and of a picture at most", file=sys.stderr)
        return 2
    name, *rest = arguments or ["twist"]
    page = ROOT / "out" / "reports" / name / "index.html"
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if not page.is_file():
        print(f"{page}: there is no report; python examples/reports/make.py {name} makes it", file=sys.stderr)
        return 1
    if browser is None:
        print(f"needs a browser: {' or '.join(BROWSERS)}; tools/programs.sh brings one", file=sys.stderr)
        return 1
    shoot(browser, page, Path(rest[0]) if rest else ROOT / "docs" / "report.png")
    return 0


def shoot(browser: str, page: Path, picture: Path) -> None:
    """What the browser shows of a page, as a PNG file of few colours."""
    with TemporaryDirectory() as folder:
        shot = Path(folder) / "shot.png"
        options = [f"--user-data-dir={folder}", f"--window-size={WINDOW[0]},{WINDOW[1]}", f"--screenshot={shot}"]
        command = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", *options]
        subprocess.run([*command, page.as_uri()], check=True, capture_output=True)
        kept = Image.open(shot).convert("RGB").quantize(COLORS, dither=Image.Dither.NONE)
        kept.save(picture, optimize=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
