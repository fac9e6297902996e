"""``python -m elvis`` is ``elvis``."""

from elvis.plugins.command.command import main

if __name__ == "__main__":
    main()
