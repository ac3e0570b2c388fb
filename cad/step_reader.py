"""The process that reads a STEP file, checks what is in it and hands the solid back: see `stiffscope.cad.step`."""

import sys
from pathlib import Path

from stiffscope.cad.step import REFUSED
from stiffscope.errors import InputError


def main(file: str, shown: str, aside: str) -> int:
    """Read `file`, called `shown` in messages, and write its solid to `aside`; return the exit code."""
    from stiffscope.cad import kernel_files
    from stiffscope.cad.soundness import sound_solid

    try:
        kernel_files.write_binary(sound_solid(kernel_files.read_step(Path(file)), shown), Path(aside))
    except InputError as refused:
        sys.stderr.write(f"\n{refused}\n")
        return REFUSED
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
