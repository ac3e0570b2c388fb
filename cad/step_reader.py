"""Subprocess of `stiffscope.cad.step`: reads a STEP file, checks its solid and writes it in the kernel's format."""

import sys
from pathlib import Path

from stiffscope.cad.step import REFUSED
from stiffscope.errors import InputError
from stiffscope.runtime.children import end_with_parent


def main(file: str, shown: str, brep: str) -> int:
    """Read `file`, called `shown` in messages, write its solid to `brep` and return the exit code."""
    from stiffscope.cad import kernel_files
    from stiffscope.cad.validity import valid_solid

    try:
        kernel_files.write_binary(valid_solid(kernel_files.read_step(Path(file)), shown), Path(brep))
    except InputError as refused:
        sys.stderr.write(f"\n{refused}\n")
        return REFUSED
    return 0


if __name__ == "__main__":
    end_with_parent()
    sys.exit(main(*sys.argv[1:]))
