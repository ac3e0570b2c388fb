"""The same experiment in CalculiX: C3D10 elements, a clamp, a rigid face, six loads in one run."""

import re
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

PEAK = (  # a small process between, so that the peak is the solver's alone
    "import resource, subprocess, sys; code = subprocess.call(sys.argv[1:]); "
    "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss, file=sys.stderr); sys.exit(code)"
)


@dataclass(frozen=True)
class Run:
    """(6, 6) compliance, seconds of the whole process and its peak memory in MB."""

    compliance: np.ndarray
    seconds: float
    megabytes: float


def ccx():
    """Path of the solver, or None."""
    return shutil.which("ccx")


def deck(mesh, youngs_modulus, poisson, clamped, loaded, point, *, perturbation):
    """Input file: nodes in m, N; the loaded face is a rigid body with a reference and a rotation node."""
    count = len(mesh.points)
    reference, rotation = count + 1, count + 2
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{k + 1},{x:.12e},{y:.12e},{z:.12e}" for k, (x, y, z) in enumerate(mesh.points)]
    lines += [f"{node},{point[0]:.12e},{point[1]:.12e},{point[2]:.12e}" for node in (reference, rotation)]
    lines.append("*ELEMENT, TYPE=C3D10, ELSET=SOLID")  # CalculiX's order of the nodes is VTK's
    lines += [",".join(map(str, [k + 1, *(row + 1)])) for k, row in enumerate(mesh.cells)]
    for name, nodes in (("CLAMP", clamped), ("FACE", loaded)):
        lines += [f"*NSET, NSET={name}", *(f"{node + 1}," for node in nodes)]
    lines += [
        "*BOUNDARY", "CLAMP,1,3",
        f"*RIGID BODY, NSET=FACE, REF NODE={reference}, ROT NODE={rotation}",
        "*MATERIAL, NAME=M", "*ELASTIC", f"{youngs_modulus:.12e},{poisson:.12e}",
        "*SOLID SECTION, ELSET=SOLID, MATERIAL=M",
        f"*NSET, NSET=OUT\n{reference},{rotation}",
    ]  # fmt: skip
    for k in range(6):
        lines += [
            f"*STEP{', PERTURBATION' if perturbation else ''}", "*STATIC",
            "*CLOAD, OP=NEW", f"{(reference, rotation)[k // 3]},{k % 3 + 1},1.",
            "*NODE PRINT, NSET=OUT", "U", "*END STEP",
        ]  # fmt: skip
    return "\n".join(lines) + "\n"


def run(folder, text, environment):
    """Run the solver on a deck; return what it says and costs."""
    folder = Path(folder)
    (folder / "part.inp").write_text(text)
    started = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", PEAK, ccx(), "-i", "part"],
        cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=1200,
    )  # fmt: skip
    seconds = time.perf_counter() - started
    peak = int(done.stderr.split()[-1]) / 1e3
    numbers = [
        [float(value) for value in line.split()]
        for line in (folder / "part.dat").read_text().splitlines()
        if re.match(r"\s*\d+\s+[-\d.]+E", line)
    ]
    moved = np.array(numbers)
    if moved.shape != (12, 4):
        raise RuntimeError(f"CalculiX printed {moved.shape} rows: {done.stdout[-400:]}")
    return Run(moved[:, 1:].reshape(6, 6).T, seconds, peak)
