"""What every field of every command's JSON holds, in words and unit; `json_answers` compares it with what is written.

A path names a field: ``a.b`` a field within a field, ``[]`` each of a list, ``*`` any name (of a part, a pose, …), and
``?`` at the end what only some answers have.
"""

from __future__ import annotations

TWIST = "m, rad"
STIFF = "N/m, N, N·m/rad"
YIELDS = "m/N, 1/N, rad/(N·m)"
RESPONSE = f"{STIFF}; {TWIST}; Hz; kg"
PUBLISHED = ["biglide", "--components", "published"]
COARSE = ["biglide", "--part", "link", "--set", "link.mesh.size=60mm"]
CONVENTION = {
    "convention.order": ("order of the components of twist and wrench, and their units", ""),
    "convention.point": ("point to which they refer", ""),
    "convention.axes": ("their axes", ""),
    "convention.units": ("SI", ""),
}
AT = {
    "poses": ("pose as commanded: the coordinates that `[tool] pose` of the robot file names", TWIST),
    "tool": ("pose of the tool: x y z of M, rotation vector from home", TWIST),
}
STIFFNESS = {
    **AT,
    "stiffness": (
        "[pose][i][j]: component i of the wrench at M for a unit of component j of the twist; null where it is rigid",
        STIFF,
    ),
    "compliance": ("[pose][i][j]: component i of the twist at M for a unit of component j of the wrench", YIELDS),
    "rigid": ("[pose]: wrenches of unit size along which the tool does not yield", "N, N·m"),
    "sag": ("[pose]: twist of the tool under the robot's own weight; zeros with `--gravity none`", TWIST),
    "mobility": ("[pose]: directions in which the tool moves freely; 0: stiff in all six", ""),
    "error?": ("95 % bounds on `stiffness`, where a part's matrix has bounds", STIFF),
    **CONVENTION,
}
PART = {
    "part": ("name of the part", ""),
    "compliance": ("[i][j]: component i of the twist for a unit of component j of the wrench, clamped", YIELDS),
    "error": ("95 % bounds on `compliance`", YIELDS),
    "reference_point": ("point of twist and wrench, in the part's axes", "m"),
    "reference_points?": ("of several loaded interfaces: the point of each", "m"),
    "flexibility?": ("of several loaded interfaces: compliance of all together, six rows and columns each", YIELDS),
    "flexibility_error?": ("95 % bounds on `flexibility`", YIELDS),
    "interface": ("how the loaded face deforms: `rigid` or `distributed`", ""),
    "foundation": ("stiffness per area of the clamp; null: fixed", "N/m³"),
    "tolerance": ("bound that was wanted; null: none", "relative"),
    "relative_bound": ("largest bound of the entries above 1 % of √(C_ii C_jj)", "relative"),
    "note": ("why the tolerance was not met; empty where it was", ""),
    "axes": ("how the part's axes lie", ""),
    "solid": ("`parametric`, or the name of the STEP file", ""),
    "mesh.nodes": ("nodes of the mesh", ""),
    "mesh.tetrahedra": ("elements of the mesh", ""),
    "mesh.order": ("polynomial order of its geometry", ""),
    "volume": ("of the mesh", "m³"),
    "cad_volume": ("of the CAD solid", "m³"),
    "mass": ("of the solid", "kg"),
    "mass_centre": ("centre of mass, part axes", "m"),
    "inertia": ("about the centre of mass, part axes", "kg·m²"),
    "self_weight": ("[k]: twist of the reference point for 1 m/s² along axis k, clamped", "m, rad per m/s²"),
    "self_weight_error": ("95 % bounds on `self_weight`", "m, rad per m/s²"),
    "frequencies": ("six lowest natural frequencies of the clamped part", "Hz"),
    "frequency_error": ("95 % bounds on them", "Hz"),
    "mode_squares": ("ω² of the fixed-interface modes in `condensed_mass`", "rad²/s²"),
    "mode_squares_error": ("95 % bounds on them", "rad²/s²"),
    "condensed_mass": (
        "on the twists of the clamp and of each loaded interface, six rows each, then on the fixed-interface modes",
        "kg, kg·m, kg·m²",
    ),
    "seconds": ("wall time by stage: cad, mesh, solve", "s"),
    "beam": ("the same matrix by beam theory (Timoshenko); null for a STEP file's solid", YIELDS),
    "cached": ("whether the cache had it", ""),
}
RESPONSES = {
    "stiffness": ("[pose][i][j]: stiffness at M", STIFF),
    "sag": ("[pose]: twist of the tool under the robot's own weight", TWIST),
    "frequency": ("[pose]: first natural frequency, drives held", "Hz"),
    "mass": ("of the robot's solids and rigid bodies", "kg"),
}
NEXT = (
    "what to read next, null where nothing would help: pose (`pose` or coordinates by name), `wrench` at M or `load`, "
    "`quantity` or `sensors`; `separates`: which explanations; `expected_gain`: expected ln-odds"
)
SHARES = {
    "singles": ("share of single effects with ln-odds above 10 that are right", "1"),
    "pairs": ("share of pairs that are right", "1"),
    "triples": ("share of triples that are right", "1"),
    "false_alarms": ("share of campaigns without an effect in which one is named", "1"),
    "outside": ("share of effects outside the library that are identified as one of it", "1"),
    "distinguishable": ("the same of those that no three effects with a word imitate to within the noise", "1"),
    "left_out": ("share of effects taken out of the library for which no wrong one is named with confidence", "1"),
    "coverage": ("share of the 95 % intervals that hold the true value", "1"),
}


def within(path: str, fields: dict[str, tuple[str, str]]) -> dict[str, tuple[str, str]]:
    """Put fields below a path."""
    return {f"{path}.{name}": said for name, said in fields.items()}


GRID = {
    "dims": ("names of the axes of an array", ""),
    "attrs.*": ("what netCDF says of it: `units`, `long_name`, …", ""),
}
DATASET = {
    "attrs.*": ("what netCDF says of all of it: title, source, conventions", ""),
    "dims.*": ("number of values along each axis", ""),
    **within("coords.*", GRID),
    "coords.*.data": ("values of a coordinate", "`attrs.units`"),
    **within("data_vars.*", GRID),
}

ANSWERS: dict[str, tuple[list[str], dict[str, tuple[str, str]]]] = {
    "run": (
        ["run", "biglide", *COARSE[3:], "--set", "slider.mesh.size=60mm", "--out", "DIR"],
        {
            **within("parts.*", PART),
            **STIFFNESS,
            "names": ("names of the poses", ""),
            "components.*": ("where each part's matrix comes from: `fea`, `beam`, `published`, `step`, `matrix`", ""),
        },
    ),
    "stiffness": (["stiffness", *PUBLISHED], STIFFNESS),
    "deflection": (
        ["deflection", *PUBLISHED, "--wrench", "100,0,0,0,0,0"],
        {
            **AT,
            "wrench": ("on the tool at M", "N, N·m"),
            "twist": ("[pose]: twist of the tool under it", TWIST),
            "energy": ("[pose]: strain energy", "J"),
            "shares.*": ("[pose]: share of an element in it", "1"),
            **CONVENTION,
        },
    ),
    "map": (
        ["map", *PUBLISHED, "--points", "5", "--gravity", "none", "--out", "DIR"],
        {
            **DATASET,
            "data_vars.*.data": (
                "over the grid, null out of reach: `K_tx` …, `K_tx_loaded` … under own weight, `sag_x` …, `f1` …",
                "`attrs.units`",
            ),
        },
    ),
    "modes": (
        ["modes", *PUBLISHED, "--at", "Q1"],
        {
            **AT,
            "frequencies": ("[pose][mode], lowest first; 0: moves freely", "Hz"),
            "error": ("[pose][mode]: 95 % bounds on them", "Hz"),
            "shapes.*": ("[pose][mode]: twist of each node at M, base axes, for a modal mass of 1 kg", TWIST),
            "energy.*": ("[pose][mode]: share of each element in the strain energy", "1"),
            "internal": ("[pose][mode]: share of the parts' modes between their ends", "1"),
            "remarks": ("what moves freely and was left out", ""),
            **CONVENTION,
        },
    ),
    "frf": (
        ["frf", *PUBLISHED, "--at", "Q1", "--from", "tool:M:z", "--to", "tool:M:z", "--points", "9", "--out", "DIR"],
        {
            **DATASET,
            "data_vars.*.data": (
                "[pose][frequency]: `real`, `imaginary`, `magnitude`, `phase` of the receptance",
                "`attrs.units`",
            ),
        },
    ),
    "sensitivity": (
        ["sensitivity", *PUBLISHED],
        {
            "poses": AT["poses"],
            **RESPONSES,
            "parameters.*.value": ("the number in the robot file", "`unit`"),
            "parameters.*.unit": ("its unit, SI", ""),
            "parameters.*.tolerance": ("its tolerance; null where the file gives none", "`unit`"),
            **{
                f"parameters.*.{name}": (f"derivative of `{name}`", f"{unit} per `unit`")
                for name, (_, unit) in RESPONSES.items()
            },
            **{
                f"parameters.*.{name}_error": (
                    f"95 % bounds on the derivative of `{name}`",
                    f"{RESPONSES[name][1]} per `unit`",
                )
                for name in ("stiffness", "sag", "frequency")
            },
            "parameters.*.stiffness_per_kilogram": (
                "change of `stiffness` for each kilogram that the parameter adds; null where it adds none",
                "per kg",
            ),
            "scatter": (
                "95 % bounds of stiffness, sag, frequency and mass by the tolerances of the file; null without any",
                RESPONSE,
            ),
            "notes": ("by name: why a number has no derivative", ""),
            **CONVENTION,
        },
    ),
    "sensitivity --part": (
        ["sensitivity", *COARSE],
        {
            "part": ("name of the part", ""),
            "parameters.*.value": ("the dimension or material constant", "`unit`"),
            "parameters.*.unit": ("its unit, SI", ""),
            **{
                f"parameters.*.{name}": (f"derivative of `{name}`{words}", f"{unit} per `unit`")
                for name, words, unit in (
                    ("compliance", "", YIELDS),
                    ("self_weight", ", the twist of the reference point for 1 m/s² along each axis", "m, rad per m/s²"),
                    ("mass", "", "kg"),
                    ("centre", ", the centre of mass", "m"),
                    ("condensed_mass", ", on the twists of clamp and interfaces", "kg, kg·m, kg·m²"),
                    ("flexibility?", ", of all loaded interfaces together", YIELDS),
                )
            },
            "parameters.*.error": ("95 % bounds on the derivative of the compliance", f"{YIELDS} per `unit`"),
            "parameters.*.self_weight_error": ("95 % bounds on that of `self_weight`", "m, rad per m/s² per `unit`"),
            "parameters.*.flexibility_error?": ("95 % bounds on that of `flexibility`", f"{YIELDS} per `unit`"),
            "notes": ("by name: why a number has no derivative", ""),
            "seconds": ("wall time by stage", "s"),
        },
    ),
    "study": (
        ["study", "STUDY.toml", "--out", "DIR"],
        {
            "study": ("path of the study's file", ""),
            "method": ("`grid`, `latin-hypercube`, `sobol`, `optimum` or `pareto`", ""),
            "columns": ("names of the columns of `rows`: parameters, responses, state, best, reason of a failure", ""),
            "rows": (
                "a row for each design, in the order of `columns`; null for what a failed design has not",
                "SI, as `columns` say",
            ),
            "best": ("numbers of the best designs, from 1", ""),
            "converged": ("whether the search converged; null of a sweep", ""),
            "search": ("how each part of the search ended, a line each", ""),
            "bounds[].parameter?": ("a parameter that best designs have at an end of its range", ""),
            "bounds[].end?": ("`lower` or `upper`", ""),
            "bounds[].designs?": ("how many of the best designs have it there", ""),
            "nearest": (
                "where no design is feasible, the nearest: its number, the constraint that binds, its value",
                "",
            ),
        },
    ),
    "compliance": (["compliance", *COARSE], PART),
    "compare": (
        ["compare", *COARSE],
        within(
            "*",
            {
                "part": ("name of the part", ""),
                "entries[].name": ("entry of the compliance, such as `C11`", ""),
                "entries[].unit": ("its unit", ""),
                "entries[].fea": ("by the virtual experiment", "`unit`"),
                "entries[].error": ("95 % bound on it", "`unit`"),
                "entries[].euler_bernoulli": ("by beam theory without shear", "`unit`"),
                "entries[].timoshenko": ("by beam theory with shear", "`unit`"),
                "entries[].published": ("as published; null where nothing was", "`unit`"),
                "findings": ("which assumption fails where, a sentence each", ""),
            },
        ),
    ),
    "compare ROBOT ROBOT": (
        ["compare", "serial-arm", "serial-arm", "--components", "beam", "--set", "joints.J1.drive.stiffness=5e4"],
        {
            "robots": ("names of both", ""),
            "poses": ("names of the poses that both reach", ""),
            "stiffness": ("[robot][pose][i][j]: at M, without gravity", STIFF),
            "sag": ("[robot][pose]: twist of the tool under the robot's own weight", TWIST),
            "ratio": ("[pose]: diagonal of the second robot's stiffness over the first's", "1"),
        },
    ),
    "interfaces": (
        ["interfaces", *COARSE, "--out", "DIR"],
        {
            "part": ("name of the part", ""),
            "reference_point": ("point of twist and wrench of all matrices, part axes", "m"),
            "choices[].name": ("choice of interface and clamp, the robot file's own first", ""),
            "choices[].words": ("what it is", ""),
            "choices[].set": ("`--set` options that choose it", ""),
            **{
                f"choices[].{name}": PART[name]
                for name in (
                    "compliance",
                    "error",
                    "tolerance",
                    "relative_bound",
                    "note",
                    "mesh.nodes",
                    "mesh.tetrahedra",
                    "mesh.order",
                )
            },
            "left_out": ("choices that the part does not have, and why", ""),
        },
    ),
    "faces": (
        ["faces", "PART.step"],
        {
            "[].index": ("number of the face, from 0", ""),
            "[].kind": ("`plane`, `cylinder`, `cone`, `sphere`, `torus` or `other`", ""),
            "[].area_mm2": ("area", "mm²"),
            "[].centroid_mm": ("centroid, in the file's axes", "mm"),
            "[].axis": ("outward normal of a plane, axis of a round face, else null; a unit vector", ""),
            "[].radius_mm": ("radius, of a torus the minor one; null where there is none", "mm"),
        },
    ),
    "check": (
        ["check", "biglide"],
        {
            "robot": ("name of the robot", ""),
            "file": ("path of its file", ""),
            "usable": ("whether the robot can be used as it is", ""),
            "error": ("why it cannot; empty where it can", ""),
            "remarks": ("what stands out, a sentence each", ""),
            "doubts[].solids?": ("of an imported assembly: solids that should be looked at", ""),
            "doubts[].text?": ("what was taken, and what they may be", ""),
            "doubts[].at?": ("where, (3,) in base axes; null where nowhere", "m"),
            "bodies[].name": ("name of a body", ""),
            "bodies[].part": ("its part; null for a rigid body", ""),
            "bodies[].mass": ("its mass; null where only the part's CAD solid tells", "kg"),
            "joints[].name": ("name of a joint", ""),
            "joints[].type": ("its type, as in the robot file", ""),
            "joints[].between": ("the two bodies or ends", ""),
            "joints[].at": ("where it is at home, base axes", "m"),
            "joints[].axis": ("its axis, a unit vector in base axes; null where it has none", ""),
            "joints[].driven": ("whether it has a drive", ""),
            "drives[].name": ("name of a driven joint", ""),
            "drives[].stiffness": ("of its drive", "N/m, N·m/rad"),
            "drives[].unit": ("unit of `range`: m or rad", ""),
            "drives[].range": ("least and greatest displacement from home; null: no limit", "`unit`"),
            "degrees_of_freedom.mechanism": ("degrees of freedom of the mechanism", ""),
            "degrees_of_freedom.tool": ("of the tool", ""),
            "degrees_of_freedom.tool_motions": ("motions of the tool, in words", ""),
            "degrees_of_freedom.coordinates.*": (
                "of each tool coordinate: `commanded`, `follows`, `free`, `locked` or `held`",
                "",
            ),
            "degrees_of_freedom.joint_freedoms": ("sum of the joints' freedoms", ""),
            "degrees_of_freedom.loops": ("independent loops", ""),
            "degrees_of_freedom.formula": ("degrees of freedom by counting alone: joint freedoms - 6 × loops", ""),
            "redundant_constraints[].count": ("constraints that follow from others", ""),
            "redundant_constraints[].loops": ("number of loops that they are in", ""),
            "redundant_constraints[].bodies": ("bodies of these loops", ""),
            "redundant_constraints[].joints": ("joints of these loops", ""),
            "redundant_constraints[].directions": ("directions of these constraints, in words", ""),
            "idle_motions[].count?": ("motions that move neither tool nor drives", ""),
            "idle_motions[].bodies?": ("bodies that they move", ""),
            "idle_motions[].joints?": ("joints that they move", ""),
            "idle_motions[].motion?": ("the motion in words", ""),
            "undriven_motions": ("motions of the tool that no drive holds", ""),
            "redundant_drives.count": ("drives more than independent", ""),
            "redundant_drives.names": ("those among which they are", ""),
            "conditioning": ("of the tool's motion by the drives, at home: 1 best, 0 singular", "1"),
            "constraint_margin": ("how far the constraints are from losing rank, at home: 1 best, 0 singular", "1"),
            "residual": ("largest gap of a loop at home", "m"),
            "mass": ("of all bodies; null where one is known by CAD only", "kg"),
            "parts.*.shape": ("`rod`, `plate`, `step` or `matrix`", ""),
            "parts.*.source": ("where its matrix comes from", ""),
            "parts.*.length": ("from clamp to reference point", "m"),
            "parts.*.mass": ("of the part; null: by CAD", "kg"),
            "parts.*.bodies": ("bodies made of it", ""),
            "reach.*.low": ("least value of this tool coordinate, others as at home", TWIST),
            "reach.*.high": ("greatest value", TWIST),
            "reach.*.at_low": ("what ends it there; empty: no limit up to there", ""),
            "reach.*.at_high": ("the same at the other end", ""),
            "poses.*.pose": ("coordinates of a named pose, home first", TWIST),
            "poses.*.reached": ("whether it is reached", ""),
            "poses.*.reason": ("why it is not", ""),
            "poses.*.drives": ("displacement of each drive from home there", TWIST),
            "poses.*.conditioning": ("as `conditioning`, there", "1"),
            "map_reached": ("share of the points of `[map]` that are reached; null without one", "1"),
        },
    ),
    "robots": (["robots"], {"*": ("what the robot of this name is", "")}),
    "new": (["new", "delta", "ROBOT.toml"], {"file": ("path of the file that was written", "")}),
    "import": (
        ["import", "ARM.urdf", "--out", "ROBOT-2.toml"],
        {
            "file": ("path of the file that was written", ""),
            "bodies": ("number of bodies", ""),
            "joints": ("number of joints", ""),
            "notes": ("what was left out or guessed, a sentence each", ""),
            "joints_found.*.type?": ("of an assembly: kind of the joint A/B", ""),
            "joints_found.*.reason?": ("the contacts that make it", ""),
            "hardware.*?": ("of an assembly: role of a solid that is no part, and why", ""),
            "doubts[].solids?": ("of an assembly: solids that should be looked at", ""),
            "doubts[].text?": ("what was taken, and what they may be", ""),
            "doubts[].at?": ("where, (3,) in the axes of the assembly; null where nowhere", "m"),
            "changes?": ("of an assembly: what is otherwise than at the last import to the same file, else null", ""),
        },
    ),
    "path": (
        ["path", "JOB.toml", "--compensate", "--out", "DIR"],
        {
            "job": ("file of the job", ""),
            "robot": ("name of the robot", ""),
            "points": ("number of points", ""),
            "length": ("of the path", "m"),
            "rms": ("of the size of the tool's error", "m"),
            "columns.*": ("[point]: the columns of `path.csv`, by name", "SI"),
            "worst.line": ("line of the path's file where the error is greatest while the process acts", ""),
            "worst.s": ("length up to there", "m"),
            "worst.error": ("twist of the tool from where it should be", TWIST),
            "worst.size": ("size of its translation", "m"),
            "worst.normal": ("its part across the path, to the left seen from the spindle", "m"),
            "worst.along": ("its part along the path", "m"),
            "worst.binormal": ("its part square to both", "m"),
            "worst.bound": ("95 % bound on the size, from the error bars of the parts", "m"),
            "worst.shares.*": ("share of an element in the strain energy", "1"),
            "worst.drives.*": ("what a drive carries", "N, N·m"),
            "worst.stress[].body?": ("greatest von Mises stress first; empty without parts from FEA", ""),
            "worst.stress[].part?": ("that it is made of", ""),
            "worst.stress[].material?": ("of the part", ""),
            "worst.stress[].von_mises?": ("greatest, beyond the elements that touch a clamped or loaded face", "Pa"),
            "worst.stress[].at?": ("where, in the part's axes", "m"),
            "worst.stress[].factor?": ("the job's yield strength over it; null where it states none", "1"),
            "frequencies.s": ("[station]: points of the path", "m"),
            "frequencies.first": ("[station]: first natural frequency there; null without masses", "Hz"),
            **{
                f"process.{name}?": (words, unit)
                for name, words, unit in (
                    ("feed", "mean force on the tool along the path", "N"),
                    ("across", "to the left, seen from the spindle", "N"),
                    ("axial", "along the tool's axis", "N"),
                    ("torque", "about the tool's axis", "N·m"),
                    ("power", "of the cut", "W"),
                    ("speed", "of the spindle", "1/s"),
                    ("tooth_passing", "teeth that pass in a second", "1/s"),
                    ("chip", "mean thickness of the chip", "m"),
                )
            },
            "free.least?": ("the error that the free coordinates make least: normal, binormal or size", ""),
            "free.fixed.NAME?": ("the best single value of a free coordinate", "m, rad"),
            **{
                f"free.{which}.{size}?": (f"{size} of that error, {how}", "m")
                for which, how in (("single", "with the best single values"), ("chosen", "as chosen"))
                for size in ("greatest", "rms")
            },
            "compensated.before?": ("rms error with the commands of the path", "m"),
            "compensated.after?": (
                "rms of what the compensated commands leave, of the commanded coordinates",
                "m, rad",
            ),
            "compensated.largest?": ("the largest of it", "m, rad"),
            "compensated.refused[]?": ("line and reason of points that keep their command", ""),
        },
    ),
    "element": (
        ["element", "BEARING.toml"],
        {
            "kind": ("of the element", ""),
            "stiffness": ("[i][j]: at its middle, x along its axis; zero along what is free", STIFF),
            "compliance": ("[i][j]: its inverse over what is held", YIELDS),
            "free": ("components x y z rx ry rz that are free, from 0", ""),
            "twist": ("of the moved side under preload and load", TWIST),
            "loads": ("of each rolling element", "N"),
            "angles": ("of each contact against the radial plane", "rad"),
            "source": ("of the formulas or figures", ""),
            "notes": ("what limits the result, a sentence each", ""),
        },
    ),
    "keys": (
        ["keys", "milling"],
        {
            "*.*": ("by kind of file and section: `key`, `means`, `takes` and `default` of each key", ""),
        },
    ),
    "campaign new": (
        ["campaign", "new", "five-bar", "--out", "CAMPAIGN", "--ask", "base-compliance from actuator-stiffness"],
        {
            "folder": ("path of the folder that was written", ""),
            "readings": ("number of readings to fill in", ""),
            "poses": ("number of poses", ""),
            "plan.sensors": ("with `--ask`: names of the sensors that are read", ""),
            "plan.loads": ("names of the hooks that are pulled", ""),
            "plan.enough": ("expected ln-odds that each pair of causes is to reach", ""),
            "plan.pairs[].first": ("`effect @ place` that is true", ""),
            "plan.pairs[].second": ("`effect @ place` that may be taken for it, or `no effect`", ""),
            "plan.pairs[].ln_odds": ("expected ln-odds of the first, the least of its parameters", ""),
            "plan.pairs[].hidden": (
                "parameters of the first that no reading that is offered tells from the second",
                "",
            ),
            "plan.pairs[].asked": ("whether both are of the question", ""),
        },
    ),
    "campaign check": (
        ["campaign", "check", "CAMPAIGN"],
        {
            "robot": ("the robot file that `campaign.toml` names; null for a table of predictions", ""),
            "readings": ("number of readings", ""),
            "empty": ("readings without a value", ""),
            "kinds.*": ("number of readings of each kind: `deflection`, `deviation`, `stiffness`, …", ""),
            "coordinates": ("names of the coordinates of a pose", ""),
            "poses.*": ("coordinates of each pose", TWIST),
            "sessions.*": ("number of readings in each session", ""),
            "without_sigma": ("readings whose uncertainty is unknown", ""),
            "copies": ("line that names readings which repeat others to the last digit; null: none do", ""),
            "remarks": (
                "readings to doubt: `doubt`, `instrument` (or load), `where` (files and lines) and `text` of each",
                "",
            ),
            "channels[].reads": ("what is read: a sensor, or a quantity at M", ""),
            "channels[].kind": ("kind of the readings", ""),
            "channels[].count": ("how many", ""),
            "channels[].unit": ("their unit", ""),
            "channels[].low": ("least value; null where none is filled in", "`unit`"),
            "channels[].high": ("greatest value", "`unit`"),
            "channels[].sigma": ("median standard uncertainty", "`unit`"),
            "sensors.*": ("each sensor as `campaign.toml` describes it, and the number of its readings", "m"),
            "loads.*": ("each load likewise", "m"),
            "largest_wrench.*": ("largest of each component of the wrenches applied", "N, N·m"),
        },
    ),
    "diagnose": (
        ["diagnose", "published", "--out", "DIR"],
        {
            "verdict": ("`identified`, `partly`, `ambiguous`, `unexplained` or `no-gap`", ""),
            "gap.nominal": ("between model and readings", "% rms"),
            "gap.explained": ("left with the effects", "% rms"),
            "gap.held_out": ("left at poses that took no part in the fit", "% rms"),
            "gap.noise": ("noise of the readings", "% rms"),
            "gap.chi2_per_reading": ("χ² per reading before and with the effects", "1"),
            "gap.left": ("what is left beyond the noise: √(explained² − noise²)", "% rms"),
            "gap.discrepancy": ("size of an unknown cause beside the effects", "% of the readings"),
            "gap.unit": ("unit of the gap", ""),
            "gap.absolute.*": (
                "of each kind that was read, its `unit` and rms `before`, `after`, `held_out` and of the `noise`",
                "`unit`",
            ),
            "effects[].effect": ("name of an effect that explains the gap", ""),
            "effects[].place": ("where it acts", ""),
            "effects[].probability": ("that it is at work", "1"),
            "effects[].gap_after": ("left when it alone is added", "% rms"),
            "effects[].parameters.*.value": ("fitted value", "`unit`"),
            "effects[].parameters.*.sigma": ("its standard uncertainty", "`unit`"),
            "effects[].parameters.*.unit": ("SI", ""),
            "effects[].parameters.*.plausible": ("whether it is within what is known of such robots", ""),
            "effects[].parameters.*.interval": ("holds the true value with a probability of 95 %", "`unit`"),
            "effects[].parameters.*.nominal": ("the model's value; null where it has none", "`unit`"),
            "effects[].confused_with": (
                "effects that these readings cannot tell from it, `effect @ place`; `unknown @ …`: what has no word",
                "",
            ),
            "effects[].share": ("its share in the explained misfit (Shapley's value)", "1"),
            "effects[].group_probability": ("that it or one of `confused_with` is at work", "1"),
            "effects[].errors": (
                "of an effect that is many small errors: each, the largest first, as in `parameters`",
                "`unit`; angles as arcs of a metre",
            ),
            "beside": (
                "what the parameters were fitted beside without being certain, as in `effects`; `unknown` has no word",
                "",
            ),
            "alternatives[].effect": ("an effect that was considered and is not in the answer", ""),
            "alternatives[].place": ("where it would act", ""),
            "alternatives[].probability": ("that it is at work", "1"),
            "alternatives[].gap_after": ("left with it alone", "% rms"),
            "alternatives[].why_not": ("why it is not in the answer", ""),
            "possible": ("effects that are merely possible, each with `effect`, `place`, `probability`", ""),
            "where.direction.*": ("share of each direction in the gap", "1"),
            "where.component": ("by name: share of each component in the gap; empty without a mechanism", "1"),
            "where.sensor.*": ("share of each sensor, or axis at M, in the gap", "1"),
            "where.left": ("by direction, of what the effects leave; empty where they bring the gap to the noise", "1"),
            "where.left_by_sensor": ("the same by sensor", "1"),
            "where.poses": ("names of the poses", ""),
            "where.pose": ("[pose][x y z rx ry rz]: rms of the residuals; null where nothing was read", "σ"),
            "where.unexplained": ("the same with the effects", "σ"),
            "next_measurement": (NEXT, "m, rad; N, N·m"),
            "remarks": ("what else to know, a sentence each", ""),
            "sensitivity[].prior": ("what of the prior is ten times as large or as small", ""),
            "sensitivity[].verdict": ("the verdict then", ""),
            "sensitivity[].probability.*": ("of each effect named, then", "1"),
            "held_out_check": (
                "readings at poses held out: `inside_95`, share within their 95 % interval; `chi2_per_reading`",
                "1",
            ),
        },
    ),
    "blind": (
        ["blind", "serial-arm", "--campaigns", "1", "--out", "DIR"],
        {
            "campaigns": ("campaigns a robot", ""),
            "seed": ("what decides which are drawn", ""),
            "seconds": ("wall time", "s"),
            **SHARES,
            "held_out_over_noise": (
                "largest gap at poses held out, over the noise, of campaigns rightly identified",
                "1",
            ),
            "calibration[].stated": ("mean of the stated probabilities, tenth by tenth", "1"),
            "calibration[].true": ("share of them that are true", "1"),
            "calibration[].count": ("how many", ""),
            **within("robots.*", SHARES),
            "confusion.planted": ("effects planted alone: rows of `counts`", ""),
            "confusion.answered": ("effects answered: columns of `counts`", ""),
            "confusion.counts": ("how often", ""),
            "outcomes[].robot": ("robot of a campaign", ""),
            "outcomes[].campaign": ("its number", ""),
            "outcomes[].kind": ("`single`, `pair`, `triple`, `none` or `outside`", ""),
            "outcomes[].measured": ("`tool`: readings at M; `sensors`: gauges and a hook; `sag`", ""),
            "outcomes[].truth": ("what was planted, `effect @ place`", ""),
            "outcomes[].left_out": ("the effect taken out of the library; null: none", ""),
            "outcomes[].imitated": (
                "of an outside effect: whether three effects with a word do the same to the readings",
                "",
            ),
            "outcomes[].verdict": ("of the diagnosis", ""),
            "outcomes[].named": ("effects that it names", ""),
            "outcomes[].confused_with": ("for each of them: what the readings cannot tell from it", ""),
            "outcomes[].right": ("whether the answer is right", ""),
            "outcomes[].evidence": ("ln-odds of the best hypothesis against no effect", "1"),
            "outcomes[].gap.*": ("`nominal`, `explained`, `held_out`, `noise`", "% rms"),
            "outcomes[].covered": (
                "for each parameter rightly named: whether its 95 % interval holds the true value",
                "",
            ),
        },
    ),
    "audit": (
        ["audit"],
        {
            "[].source": ("equation or table of the paper", ""),
            "[].entry": ("which number of it", ""),
            "[].published": ("as printed", "SI; RMS in %"),
            "[].as_published": (
                "by the paper's equations read as printed; null where they give nothing",
                "SI; RMS in %",
            ),
            "[].correct": ("recomputed correctly", "SI; RMS in %"),
            "[].bound": ("what no Biglide can exceed; null where there is none", "SI"),
            "[].verdict": ("in words", ""),
        },
    ),
    "cache": (
        ["cache"],
        {
            "folder": ("where results are kept", ""),
            "kinds.*.entries": ("number of results of a kind", ""),
            "kinds.*.bytes": ("their size", "bytes"),
        },
    ),
    "cache list": (
        ["cache", "list"],
        {
            "[].kind": ("kind of a result", ""),
            "[].key": ("hash of all that determines it", ""),
            "[].bytes": ("its size", "bytes"),
            "[].made": ("when it was made, since 1970", "s"),
        },
    ),
    "cache clear": (
        ["cache", "clear", "--kind", "none"],
        {
            "folder": ("where results are kept", ""),
            "entries": ("number of results removed", ""),
            "bytes": ("their size", "bytes"),
        },
    ),
}
