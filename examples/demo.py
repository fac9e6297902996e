"""Draw, convert and compare the sample data: `make demo` runs this; the pictures and the report land in out/.

The commands are those that a user would type; each is printed before it runs.
"""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
COMMANDS = """
elvis info out/data/bend.xml out/data/bend.fld
elvis render out/data/cylinder.xml out/data/cylinder.fld --field Cp --colormap turbo -o out/cylinder.png
elvis render out/data/bend.xml out/data/bend.fld --plane 0,0,0:0,0,1 -o out/bend.png
elvis render out/data/bend.xml out/data/bend.fld --plane 1.4,1.4,0:-1,1,0 -o out/bend-across.png
elvis render out/data/blocks.xml out/data/blocks.fld --plane 1.5,0.5,0.45:0.1,0.2,1 -o out/blocks.png -o out/blocks.npz
elvis render out/data/blocks.xml out/data/blocks.fld --faces all --mesh-lines --camera iso -o out/blocks-faces.png
elvis render out/data/eddies0.f00000 --field vorticity_z -o out/eddies.png
elvis convert out/data/eddies0.f00000 -o out/eddies.xml
elvis compare out/data/blocks.xml out/data/blocks.fld --plane 1.5,0.5,0.45:0.1,0.2,1 --size 300x225 -o out/report
elvis probe out/data/bend.xml out/data/bend.fld --line 0,1.4,0:0,2.6,0 -n 7
"""


def main() -> None:
    """Generate the data, then run every command; stops where one fails."""
    print("$ python examples/generate.py out/data", flush=True)
    subprocess.run([sys.executable, "examples/generate.py", "out/data"], cwd=ROOT, check=True)
    for line in COMMANDS.strip().splitlines():
        print(f"\n$ {line}", flush=True)
        command = [str(Path(sys.executable).with_name("elvis")), *shlex.split(line)[1:]]
        subprocess.run(command, cwd=ROOT, check=True)
    pictures = sorted(path.name for path in (ROOT / "out").glob("*.png"))
    print(f"\nThe pictures are in out/: {', '.join(pictures)}; the accuracy report is out/report/index.html.")


if __name__ == "__main__":
    main()
