"""The command line as a module: `python -m stiffscope`."""

import sys


def run() -> None:
    """Remove the working folder, which may hold a user's numpy.py, from the path; then run."""
    if not sys.flags.safe_path:
        del sys.path[0]
    from stiffscope.cli.main import main

    main()


run()
