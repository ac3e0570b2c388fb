"""The same experiment in CalculiX at its best: C3D10 elements, a clamp, a rigid face, one factorization for six loads.

What was tried with CalculiX 2.20 of Debian (seconds and MB on the slider with 17k and the ribbed slider with 80k
degrees of freedom, two cores shared with others): six steps 2.5 s, 75 MB and 27 s, 474 MB, for each step factorizes
again, and PERTURBATION steps cost the same; *GREEN, the displacements of unit loads, 0.6 s, 59 MB and 5.2 s, 351 MB,
taken here. That is SPOOLES on one thread: on two it takes 157 MB more and 4.2 to 8.0 s. OpenBLAS changes nothing,
since SPOOLES does not call BLAS (4.7 to 5.4 s). ITERATIVE SCALING 4.0 s, 42 MB on the slider; ITERATIVE CHOLESKY 5.2 s
and 3 % off. PASTIX and PARDISO are not linked. *SUBSTRUCTURE GENERATE costs what *GREEN does, but the stiffness it
prints for the two nodes of a rigid body is not the condensed one (72 times too stiff along x on the slider).
"""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np

ROW = r"\s*\d+\s+[-\d.]+E"


def ccx():
    """Path of the solver, or None."""
    return shutil.which("ccx")


def model(points, cells, clamped, rigid, youngs_modulus, poisson, density):
    """Model data in m, N and kg; ``rigid``: sets of nodes, each with the point of its reference and rotation nodes."""
    count = len(points)
    lines = ["*NODE, NSET=ALL"]
    lines += [
        f"{k + 1},{x:.12e},{y:.12e},{z:.12e}" for k, (x, y, z) in enumerate(points)
    ]
    for k, (_, (x, y, z)) in enumerate(rigid):
        lines += [f"{count + 2 * k + own},{x:.12e},{y:.12e},{z:.12e}" for own in (1, 2)]
    lines.append(
        "*ELEMENT, TYPE=C3D10, ELSET=SOLID"
    )  # CalculiX's order of the nodes is VTK's
    lines += [",".join(map(str, [k + 1, *(row + 1)])) for k, row in enumerate(cells)]
    for name, nodes in (
        ("CLAMP", clamped),
        *((f"FACE{k}", nodes) for k, (nodes, _) in enumerate(rigid)),
    ):
        lines += (
            [f"*NSET, NSET={name}", *(f"{node + 1}," for node in nodes)]
            if len(nodes)
            else []
        )
    lines += [
        "*BOUNDARY",
        "CLAMP,1,3",
        *(
            f"*RIGID BODY, NSET=FACE{k}, REF NODE={count + 2 * k + 1}, ROT NODE={count + 2 * k + 2}"
            for k in range(len(rigid))
        ),
        "*MATERIAL, NAME=M",
        "*ELASTIC",
        f"{youngs_modulus:.12e},{poisson:.12e}",
        "*DENSITY",
        f"{density:.12e}",
        "*SOLID SECTION, ELSET=SOLID, MATERIAL=M",
    ]
    return "\n".join(lines) + "\n"


def unit_loads(count, faces=1):
    """The step of six unit loads on each rigid face of a model of ``count`` nodes: the displacements of these."""
    own = [count + k for k in range(1, 2 * faces + 1)]
    lines = [
        "*NSET, NSET=OUT",
        *(f"{node}," for node in own),
        "*STEP",
        "*GREEN",
        "*CLOAD",
        *(f"{node},{axis},1." for node in own for axis in (1, 2, 3)),
        "*NODE PRINT, NSET=OUT",
        "U",
        "*END STEP",
    ]
    return "\n".join(lines) + "\n"


def combined_loads(count, forces):
    """A step for each column of forces (6n, k), on n rigid faces of a model of ``count`` nodes."""
    own = [count + k for k in range(1, len(forces) // 3 + 1)]
    lines = ["*NSET, NSET=OUT", *(f"{node}," for node in own)]
    for column in forces.T.reshape(forces.shape[1], -1, 3):
        acts = [
            f"{n},{i + 1},{f:.12e}"
            for n, three in zip(own, column, strict=True)
            for i, f in enumerate(three)
        ]
        lines += [
            "*STEP",
            "*STATIC",
            "*CLOAD, OP=NEW",
            *acts,
            "*NODE PRINT, NSET=OUT",
            "U",
            "*END STEP",
        ]
    return "\n".join(lines) + "\n"


FREQUENCIES = "*STEP\n*FREQUENCY\n6\n*END STEP\n"


def run(folder, text, environment=None):
    """Run a deck and return the numbers (rows, columns) of the tables that the solver prints."""
    folder = Path(folder)
    (folder / "part.inp").write_text(text)
    done = subprocess.run(
        [ccx(), "-i", "part"],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=1200,
    )
    rows = [
        line.split()
        for line in (folder / "part.dat").read_text().splitlines()
        if re.match(ROW, line)
    ]
    if not rows:
        raise RuntimeError(f"CalculiX printed nothing: {done.stdout[-400:]}")
    return np.array(
        [[float(value) for value in row] for row in rows if len(row) == len(rows[0])]
    )


def compliance(folder, text, environment, faces=1):
    """(6n, 6n) compliance of a model and its unit loads: motions of the n faces' reference and rotation nodes."""
    moved = run(folder, text, environment)
    if moved.shape != (12 * faces**2, 4):
        raise RuntimeError(f"CalculiX printed {moved.shape} rows")
    return moved[:, 1:].reshape(6 * faces, 6 * faces).T


def frequencies(folder, text):
    """(6,) lowest natural frequencies of a model, Hz."""
    return np.sqrt(run(folder, text + FREQUENCIES)[:6, 1]) / (2 * np.pi)
