"""Meaning and unit of every field of every command's JSON; `json_answers` checks it.

A path names a field: ``a.b`` a field within a field, ``[]`` each item of a list, ``*`` any name (of
a part, a pose, …), and a final ``?`` a field that only some answers have.
"""

from __future__ import annotations

TWIST = "m, rad"
STIFF = "N/m, N, N·m/rad"
YIELDS = "m/N, 1/N, rad/(N·m)"
RESPONSE = f"{STIFF}; {TWIST}; Hz; kg"
PUBLISHED = ["biglide", "--components", "published"]
COARSE = ["biglide", "--part", "link", "--set", "link.mesh.size=60mm"]
CONVENTION = {
    "convention.order": ("order and units of the components of twist and wrench", ""),
    "convention.point": ("reference point of twist and wrench", ""),
    "convention.axes": ("axes of twist and wrench", ""),
    "convention.units": ("SI", ""),
}
AT = {
    "poses": (
        "commanded pose: the coordinates listed in `[tool] pose` of the robot file",
        TWIST,
    ),
    "tool": ("tool pose: x y z of M, rotation vector from home", TWIST),
}
STIFFNESS = {
    **AT,
    "stiffness": (
        "[pose][i][j]: wrench component i at M per unit of twist component j; null: rigid",
        STIFF,
    ),
    "compliance": (
        "[pose][i][j]: twist component i at M per unit of wrench component j",
        YIELDS,
    ),
    "rigid": ("[pose]: unit wrenches that cause no deflection of the tool", "N, N·m"),
    "sag": (
        "[pose]: twist of the tool under the robot's own weight; zero with `--gravity none`",
        TWIST,
    ),
    "mobility": (
        "[pose]: number of free directions of the tool; 0: constrained in all six",
        "",
    ),
    "error?": ("95 % bounds on `stiffness`, if a part's matrix has bounds", STIFF),
    **CONVENTION,
}
PART = {
    "part": ("name of the part", ""),
    "compliance": (
        "[i][j]: twist component i per unit of wrench component j, base clamped",
        YIELDS,
    ),
    "error": ("95 % bounds on `compliance`", YIELDS),
    "reference_point": ("reference point of twist and wrench, part axes", "m"),
    "reference_points?": ("reference point of each of several loaded interfaces", "m"),
    "flexibility?": (
        "full compliance of several loaded interfaces, six rows and columns each",
        YIELDS,
    ),
    "flexibility_error?": ("95 % bounds on `flexibility`", YIELDS),
    "interface": ("how the loaded face deforms: `rigid` or `distributed`", ""),
    "foundation": ("foundation stiffness per area at the clamp; null: fixed", "N/m³"),
    "tolerance": ("requested relative bound; null: none", "relative"),
    "relative_bound": (
        "largest bound of the entries above 1 % of √(C_ii C_jj)",
        "relative",
    ),
    "note": ("why the tolerance was not met; empty if it was", ""),
    "axes": ("orientation of the part axes", ""),
    "solid": ("`parametric`, or the name of the STEP file", ""),
    "mesh.nodes": ("number of nodes", ""),
    "mesh.tetrahedra": ("number of elements", ""),
    "mesh.order": ("polynomial order of the element geometry", ""),
    "volume": ("volume of the mesh", "m³"),
    "cad_volume": ("volume of the CAD solid", "m³"),
    "mass": ("mass of the solid", "kg"),
    "mass_centre": ("centre of mass, part axes", "m"),
    "inertia": ("inertia about the centre of mass, part axes", "kg·m²"),
    "self_weight": (
        "[k]: reference-point twist per m/s² along axis k, base clamped",
        "m, rad per m/s²",
    ),
    "self_weight_error": ("95 % bounds on `self_weight`", "m, rad per m/s²"),
    "frequencies": ("six lowest natural frequencies of the clamped part", "Hz"),
    "frequency_error": ("95 % bounds on `frequencies`", "Hz"),
    "mode_squares": ("ω² of the fixed-interface modes in `condensed_mass`", "rad²/s²"),
    "mode_squares_error": ("95 % bounds on `mode_squares`", "rad²/s²"),
    "condensed_mass": (
        "condensed mass: six rows for the clamp and each loaded interface, then the fixed-interface modes",
        "kg, kg·m, kg·m²",
    ),
    "seconds": ("wall time by stage: cad, mesh, solve", "s"),
    "beam": (
        "compliance by Timoshenko beam theory; null for a STEP solid or a shape without beam theory",
        YIELDS,
    ),
    "cached": ("whether the result came from the cache", ""),
}
LIMITS = {
    "critical_depth": (
        "[pose]: depth of cut that is stable at all speeds of the range; null: no limit",
        "m",
    ),
    "critical_low": ("[pose]: lower end of its 95 % band", "m"),
    "critical_high": ("[pose]: upper end of its 95 % band", "m"),
    "limit": ("[pose]: stable depth of cut at the job's speed", "m"),
    "coupling": (
        "[pose]: depth from which modes chatter without a wave left by the tooth before; null: none",
        "m",
    ),
    "chatter": ("[pose]: frequency of chatter at the critical depth", "Hz"),
    "mode": ("[pose]: natural frequency of the limiting mode", "Hz"),
}
RESPONSES = {
    "stiffness": ("[pose][i][j]: stiffness at M", STIFF),
    "push": (
        "[pose][i]: 1/C_ii, what a push meets with all other directions free; null if rigid",
        "N/m, N·m/rad",
    ),
    "sag": ("[pose]: twist of the tool under the robot's own weight", TWIST),
    "frequency": ("[pose]: first natural frequency, drives held", "Hz"),
    "mass": ("mass of the robot's solids and rigid bodies", "kg"),
}
NEXT = (
    "best next reading, or null: pose (`pose` or coordinates by name; of drives also `label`, mm and deg), "
    "`wrench` at M or `load`, `quantity` or `sensors`; `separates`: explanations it distinguishes; "
    "`expected_gain`: expected ln-odds; "
    "`new`: sensors and load points that the campaign lacks, by name, as in campaign.toml"
)
SHARES = {
    "singles": (
        "share of correct diagnoses among single effects with ln-odds above 10",
        "1",
    ),
    "pairs": ("share of pairs diagnosed correctly", "1"),
    "triples": ("share of triples diagnosed correctly", "1"),
    "false_alarms": (
        "share of campaigns without an effect for which one is reported",
        "1",
    ),
    "outside": (
        "share of effects outside the library identified as a library effect",
        "1",
    ),
    "distinguishable": (
        "the same for those that no three known effects reproduce to within the noise",
        "1",
    ),
    "left_out": (
        "share of effects removed from the library and not confidently misidentified",
        "1",
    ),
    "coverage": ("share of the 95 % intervals that contain the true value", "1"),
}


def within(path: str, fields: dict[str, tuple[str, str]]) -> dict[str, tuple[str, str]]:
    """Prefix fields with a path."""
    return {f"{path}.{name}": said for name, said in fields.items()}


GRID = {
    "dims": ("dimension names", ""),
    "attrs.*": ("netCDF attributes of the variable: `units`, `long_name`, …", ""),
}
DATASET = {
    "attrs.*": ("global netCDF attributes: title, source, conventions", ""),
    "dims.*": ("length of each dimension", ""),
    **within("coords.*", GRID),
    "coords.*.data": ("coordinate values", "`attrs.units`"),
    **within("data_vars.*", GRID),
}

ANSWERS: dict[str, tuple[list[str], dict[str, tuple[str, str]]]] = {
    "run": (
        [
            "run",
            "biglide",
            *COARSE[3:],
            "--set",
            "slider.mesh.size=60mm",
            "--out",
            "DIR",
        ],
        {
            **within("parts.*", PART),
            **STIFFNESS,
            "names": ("names of the poses", ""),
            "components.*": (
                "source of the part's matrix: `fea`, `beam`, `published`, `step`, `matrix`",
                "",
            ),
        },
    ),
    "stiffness": (["stiffness", *PUBLISHED], STIFFNESS),
    "deflection": (
        ["deflection", *PUBLISHED, "--wrench", "100,0,0,0,0,0"],
        {
            **AT,
            "wrench": ("wrench on the tool at M", "N, N·m"),
            "twist": ("[pose]: twist of the tool under `wrench`", TWIST),
            "energy": ("[pose]: strain energy", "J"),
            "shares.*": ("[pose]: share of each element in the strain energy", "1"),
            **CONVENTION,
        },
    ),
    "map": (
        ["map", *PUBLISHED, "--points", "5", "--gravity", "none", "--out", "DIR"],
        {
            **DATASET,
            "data_vars.*.data": (
                "grid, null if unreachable: `K_tx` …, `K_tx_loaded` … (own weight), `push_x` …, `sag_x` …, `f1` …",
                "`attrs.units`",
            ),
        },
    ),
    "export": (
        ["export", "serial-arm", "--to", "mjcf", "--at", "home", "--out", "DIR"],
        {
            "robot": ("name of the robot", ""),
            "target": ("form, as `--to` names it", ""),
            "poses": ("names or texts of the poses", ""),
            "files": ("files in DIR", ""),
            "timestep?": ("`mjcf`: time step that is set", "s"),
            "largest_timestep?": ("`mjcf`: largest stable one at the poses", "s"),
            "highest?": ("`mjcf`: frequency below which springs vibrate", "Hz"),
            "tool?": ("`mjcf`: [pose]: unloaded tool pose", TWIST),
            "sag?": ("`mjcf`: [pose]: twist of the tool under own weight", TWIST),
            "frequencies?": ("`mjcf`: [pose][mode]: lowest of the robot", "Hz"),
            "exported_frequencies?": (
                "`mjcf`: [pose][mode]: lowest of the model",
                "Hz",
            ),
            "deviation.compliance?": (
                "`mjcf`: largest deviation at M, over √(C_ii C_jj)",
                "relative",
            ),
            "deviation.frequency?": (
                "`mjcf`: largest deviation of these frequencies, beside the shift by `--highest`",
                "relative",
            ),
            "links?": ("`urdf`: number of links", ""),
            "cut_joints?": ("`urdf`: joints that close loops, which are cut", ""),
            "damping?": ("`statespace`: damping ratio of every mode", "1"),
            "axes?": ("`compensation`: axes of the grid", ""),
            "before?": (
                "`compensation`: greatest error between grid points without corrections",
                "m",
            ),
            "left?": (
                "`compensation`: the same with interpolated corrections",
                "m",
            ),
        },
    ),
    "modes": (
        ["modes", *PUBLISHED, "--at", "Q1"],
        {
            **AT,
            "frequencies": (
                "[pose][mode]: natural frequencies in ascending order; 0: free motion",
                "Hz",
            ),
            "error": ("[pose][mode]: 95 % bounds on `frequencies`", "Hz"),
            "shapes.*": (
                "[pose][mode]: twist of each node at M, base axes, for 1 kg modal mass",
                TWIST,
            ),
            "energy.*": (
                "[pose][mode]: share of each element in the strain energy",
                "1",
            ),
            "internal": (
                "[pose][mode]: share of the parts' fixed-interface modes",
                "1",
            ),
            "remarks": ("free motions that were excluded", ""),
            **CONVENTION,
        },
    ),
    "frf": (
        [
            "frf",
            *PUBLISHED,
            "--at",
            "Q1",
            "--from",
            "tool:M:z",
            "--to",
            "tool:M:z",
            "--points",
            "9",
            "--out",
            "DIR",
        ],
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
            "parameters.*.value": ("value in the robot file", "`unit`"),
            "parameters.*.unit": ("SI unit", ""),
            "parameters.*.tolerance": (
                "tolerance; null if the file gives none",
                "`unit`",
            ),
            **{
                f"parameters.*.{name}": (
                    f"derivative of `{name}`",
                    f"{unit} per `unit`",
                )
                for name, (_, unit) in RESPONSES.items()
            },
            **{
                f"parameters.*.{name}_error": (
                    f"95 % bounds on the derivative of `{name}`",
                    f"{RESPONSES[name][1]} per `unit`",
                )
                for name in ("stiffness", "push", "sag", "frequency")
            },
            "parameters.*.stiffness_per_kilogram": (
                "change of `stiffness` per kilogram added by the parameter; null if it adds no mass",
                "per kg",
            ),
            "scatter": (
                "95 % bounds of stiffness, push, sag, frequency and mass from the file's tolerances, if any",
                RESPONSE,
            ),
            "notes": ("by name: why a parameter has no derivative", ""),
            **CONVENTION,
        },
    ),
    "sensitivity --part": (
        ["sensitivity", *COARSE],
        {
            "part": ("name of the part", ""),
            "parameters.*.value": (
                "value of the dimension or material constant",
                "`unit`",
            ),
            "parameters.*.unit": ("SI unit", ""),
            **{
                f"parameters.*.{name}": (
                    f"derivative of `{name}`{words}",
                    f"{unit} per `unit`",
                )
                for name, words, unit in (
                    ("compliance", "", YIELDS),
                    (
                        "self_weight",
                        ", reference-point twist per m/s² along each axis",
                        "m, rad per m/s²",
                    ),
                    ("mass", "", "kg"),
                    ("centre", ", centre of mass", "m"),
                    (
                        "condensed_mass",
                        ", six rows for the clamp and each interface",
                        "kg, kg·m, kg·m²",
                    ),
                    (
                        "flexibility?",
                        ", full compliance of all loaded interfaces",
                        YIELDS,
                    ),
                )
            },
            "parameters.*.error": (
                "95 % bounds on the derivative of the compliance",
                f"{YIELDS} per `unit`",
            ),
            "parameters.*.self_weight_error": (
                "95 % bounds on `self_weight`",
                "m, rad per m/s² per `unit`",
            ),
            "parameters.*.flexibility_error?": (
                "95 % bounds on `flexibility`",
                f"{YIELDS} per `unit`",
            ),
            "notes": ("by name: why a parameter has no derivative", ""),
            "seconds": ("wall time by stage", "s"),
        },
    ),
    "study": (
        ["study", "STUDY.toml", "--out", "DIR"],
        {
            "study": ("path of the study file", ""),
            "method": ("`grid`, `latin-hypercube`, `sobol`, `optimum` or `pareto`", ""),
            "columns": (
                "column names of `rows`: parameters, responses, state, best, reason of failure",
                "",
            ),
            "rows": (
                "one row per design, in the order of `columns`; missing values of failed designs are null",
                "SI, see `columns`",
            ),
            "best": ("numbers of the best designs, starting at 1", ""),
            "converged": ("whether the search converged; null for a sweep", ""),
            "search": ("termination message of each stage of the search", ""),
            "bounds[].parameter?": (
                "parameter at a bound in some of the best designs",
                "",
            ),
            "bounds[].end?": ("`lower` or `upper`", ""),
            "bounds[].designs?": ("number of best designs at this bound", ""),
            "present": (
                "design of the robot file: `values`, `responses`, `reason` of a failure; null for a share",
                "SI",
            ),
            "nearest": (
                "if no design is feasible, the nearest one: its number, the violated constraint, its value",
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
                "entries[].name": ("compliance entry, e.g. `C11`", ""),
                "entries[].unit": ("unit of the entry", ""),
                "entries[].fea": ("value from the virtual experiment", "`unit`"),
                "entries[].error": ("95 % bound on `fea`", "`unit`"),
                "entries[].euler_bernoulli": (
                    "value by beam theory without shear; null for a shape without beam theory",
                    "`unit`",
                ),
                "entries[].timoshenko": (
                    "value by beam theory with shear; null likewise",
                    "`unit`",
                ),
                "entries[].published": (
                    "published value; null if there is none",
                    "`unit`",
                ),
                "findings": ("assumptions that fail, and where, one sentence each", ""),
            },
        ),
    ),
    "compare ROBOT ROBOT": (
        [
            "compare",
            "serial-arm",
            "serial-arm",
            "--components",
            "beam",
            "--set",
            "joints.J1.drive.stiffness=50 kN*m/rad",
        ],
        {
            "robots": ("names of the two robots", ""),
            "poses": ("names of the poses both robots reach", ""),
            "stiffness": (
                "[robot][pose][i][j]: stiffness at M, without gravity",
                STIFF,
            ),
            "push": (
                "[robot][pose][i]: 1/C_ii, what a push meets with all other directions free; null if rigid",
                STIFF,
            ),
            "sag": (
                "[robot][pose]: twist of the tool under the robot's own weight",
                TWIST,
            ),
            "mass": ("[robot]: mass of all moving bodies", "kg"),
            "push_ratio": ("[pose]: the same ratio of `push`", "1"),
            "ratio": (
                "[pose]: stiffness diagonal of the second robot divided by that of the first",
                "1",
            ),
        },
    ),
    "interfaces": (
        ["interfaces", *COARSE, "--out", "DIR"],
        {
            "part": ("name of the part", ""),
            "reference_point": (
                "common reference point of twist and wrench, part axes",
                "m",
            ),
            "choices[].name": (
                "choice of interface and clamp; the robot file's choice comes first",
                "",
            ),
            "choices[].words": ("description of the choice", ""),
            "choices[].set": ("`--set` options that select it", ""),
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
            "left_out": ("choices not applicable to the part, with reasons", ""),
        },
    ),
    "responses": (
        ["responses", "TAP.uff"],
        {
            "file": ("file that was read", ""),
            "points.*": ("place (3,) of a point of the file, in its axes", "m"),
            "lines": ("points connected by lines of the file", ""),
            "responses[].force.point": ("number or name of the point of the force", ""),
            "responses[].force.axis": ("`x`, `y`, `z`, `rx`, `ry` or `rz`", ""),
            "responses[].force.sign": ("1 along the axis, -1 against it", ""),
            "responses[].motion.point": ("the same of the motion", ""),
            "responses[].motion.axis": ("", ""),
            "responses[].motion.sign": ("", ""),
            "responses[].quantity": (
                "what the file holds: `receptance`, `mobility` or `accelerance`",
                "",
            ),
            "responses[].band": ("lowest and highest frequency", "Hz"),
            "responses[].lines": ("number of frequencies", ""),
            "responses[].resonances": ("maxima of the receptance", "Hz"),
            "responses[].static_stiffness?": (
                "null without a level part below the first resonance, and where force and motion differ",
                "",
            ),
            "responses[].static_stiffness.value?": (
                "static stiffness at a driving point",
                "N/m, N·m/rad",
            ),
            "responses[].static_stiffness.spread?": (
                "half its 95 % interval",
                "N/m, N·m/rad",
            ),
            "responses[].static_stiffness.band?": ("frequencies used", "Hz"),
            "responses[].source": ("file and line of the dataset", ""),
            "modes[].frequency?": ("mode shape of the file: its frequency", "Hz"),
            "modes[].damping?": ("damping ratio; null if not stated", ""),
            "modes[].points?": ("points of the shape", ""),
            "doubts": ("doubts on the measurement, one sentence each", ""),
            "remarks": ("doubts on units, and datasets that were not read", ""),
        },
    ),
    "faces": (
        ["faces", "PART.step"],
        {
            "[].index": ("face number, starting at 0", ""),
            "[].kind": (
                "`plane`, `cylinder`, `cone`, `sphere`, `torus` or `other`",
                "",
            ),
            "[].area_mm2": ("area", "mm²"),
            "[].centroid_mm": ("centroid, in STEP coordinates", "mm"),
            "[].axis": (
                "unit vector: outward normal of a plane, axis of a round face; otherwise null",
                "",
            ),
            "[].radius_mm": (
                "radius (torus: minor radius); null if there is none",
                "mm",
            ),
        },
    ),
    "check": (
        ["check", "biglide"],
        {
            "robot": ("name of the robot", ""),
            "file": ("path of the robot file", ""),
            "usable": ("whether the robot file is valid", ""),
            "error": ("reason if not; otherwise empty", ""),
            "remarks": ("noteworthy findings, one sentence each", ""),
            "doubts[].solids?": ("imported assembly: solids to review", ""),
            "doubts[].text?": ("assumption made, and possible alternatives", ""),
            "doubts[].at?": ("position (3,) in base axes; null if it has none", "m"),
            "doubts[].warning?": ("whether it may make numbers wrong by far", ""),
            "bodies[].name": ("name of a body", ""),
            "bodies[].part": ("part of the body; null: rigid body", ""),
            "bodies[].mass": (
                "mass of the body; null if only known from the part's CAD solid",
                "kg",
            ),
            "joints[].name": ("name of a joint", ""),
            "joints[].type": ("joint type, as in the robot file", ""),
            "joints[].between": ("the two connected bodies or body ends", ""),
            "joints[].at": ("position in the home pose, base axes", "m"),
            "joints[].axis": (
                "axis, a unit vector in base axes; null if the joint has none",
                "",
            ),
            "joints[].driven": ("whether it has a drive", ""),
            "drives[].name": ("name of a driven joint", ""),
            "drives[].stiffness": ("drive stiffness", "N/m, N·m/rad"),
            "drives[].unit": ("unit of `range`: m or rad", ""),
            "drives[].range": (
                "minimum and maximum displacement from home; null: no limit",
                "`unit`",
            ),
            "degrees_of_freedom.mechanism": ("degrees of freedom of the mechanism", ""),
            "degrees_of_freedom.tool": ("degrees of freedom of the tool", ""),
            "degrees_of_freedom.tool_motions": ("tool motions in words", ""),
            "degrees_of_freedom.coordinates.*": (
                "state of each tool coordinate: `commanded`, `follows`, `free`, `locked` or `held`",
                "",
            ),
            "degrees_of_freedom.joint_freedoms": ("sum of the joint dofs", ""),
            "degrees_of_freedom.loops": ("number of independent loops", ""),
            "degrees_of_freedom.formula": (
                "Grübler-Kutzbach count: joint dofs - 6 × loops",
                "",
            ),
            "redundant_constraints[].count": ("number of redundant constraints", ""),
            "redundant_constraints[].loops": ("number of loops involved", ""),
            "redundant_constraints[].bodies": ("bodies in these loops", ""),
            "redundant_constraints[].joints": ("joints in these loops", ""),
            "redundant_constraints[].directions": (
                "directions of these constraints in words",
                "",
            ),
            "idle_motions[].count?": (
                "number of motions that move neither tool nor drives",
                "",
            ),
            "idle_motions[].bodies?": ("bodies that move", ""),
            "idle_motions[].joints?": ("joints that move", ""),
            "idle_motions[].motion?": ("the motion in words", ""),
            "undriven_motions": ("tool motions not constrained by a drive", ""),
            "redundant_drives.count": ("number of redundant drives", ""),
            "redundant_drives.names": (
                "drives determined by other drives or by the loops",
                "",
            ),
            "conditioning": (
                "inverse condition number from drives to tool at home: 0 singular",
                "1",
            ),
            "constraint_margin": (
                "inverse condition number of the constraints at home: 0 singular",
                "1",
            ),
            "residual": ("largest loop closure error at home", "m"),
            "mass": (
                "total mass of the bodies; null if one is only known from CAD",
                "kg",
            ),
            "parts.*.shape": ("`rod`, `plate`, `step` or `matrix`", ""),
            "parts.*.source": ("source of its matrix", ""),
            "parts.*.length": ("distance from clamp to reference point", "m"),
            "parts.*.mass": ("mass of the part; null: from CAD", "kg"),
            "parts.*.bodies": ("bodies made of this part", ""),
            "reach.*.low": (
                "minimum of this tool coordinate, the others at home",
                TWIST,
            ),
            "reach.*.high": ("maximum of this tool coordinate", TWIST),
            "reach.*.at_low": (
                "what limits it there; empty: no limit found within this range",
                "",
            ),
            "reach.*.at_high": ("what limits it at the maximum", ""),
            "poses.*.pose": ("coordinates of the named pose; home comes first", TWIST),
            "poses.*.reached": ("whether the pose is reachable", ""),
            "poses.*.reason": ("reason if not", ""),
            "poses.*.drives": ("displacement of each drive from home", TWIST),
            "poses.*.conditioning": ("inverse condition number at this pose", "1"),
            "map_reached": (
                "share of reachable points of `[map]`; null without `[map]`",
                "1",
            ),
        },
    ),
    "robots": (["robots"], {"*": ("description of the robot", "")}),
    "new": (["new", "delta", "ROBOT.toml"], {"file": ("path of the file written", "")}),
    "import": (
        ["import", "ARM.urdf", "--out", "ROBOT-2.toml"],
        {
            "file": ("path of the file written", ""),
            "bodies": ("number of bodies", ""),
            "joints": ("number of joints", ""),
            "notes": ("omissions and assumptions, one sentence each", ""),
            "joints_found.*.type?": ("assembly: type of the joint A/B", ""),
            "joints_found.*.reason?": (
                "contacts from which the joint was inferred",
                "",
            ),
            "hardware.*?": (
                "assembly: role of a solid that is not a part, with reason",
                "",
            ),
            "doubts[].solids?": ("assembly: solids to review", ""),
            "doubts[].text?": ("assumption made, and possible alternatives", ""),
            "doubts[].at?": (
                "position (3,) in assembly axes; null if it has none",
                "m",
            ),
            "doubts[].warning?": ("whether it may make numbers wrong by far", ""),
            "changes?": (
                "assembly: changes since the last import to the same file; otherwise null",
                "",
            ),
        },
    ),
    "lobes": (
        ["lobes", "LOBES.toml", "--out", "DIR"],
        {
            "job": ("path of the job file", ""),
            "robot": ("name of the robot", ""),
            "method": ("`zero-order` or `all-harmonics`", ""),
            "names": ("names of the poses of the lobes", ""),
            **AT,
            "speed": ("spindle speeds of the lobes", "rpm"),
            "depth": ("[pose][speed]: stable depth of cut; null: no limit found", "m"),
            "error": ("[pose][speed]: half width of the 95 % band; null: no end", "m"),
            "low": ("[pose][speed]: lower end of the 95 % band", "m"),
            "high": ("[pose][speed]: upper end of the 95 % band; null: no end", "m"),
            **LIMITS,
            "cause.*": (
                "share of each element in the limiting mode's strain energy, at the pose of least critical depth",
                "1",
            ),
            "causes.*": ("[pose]: the same at every pose", "1"),
            "levers[].element": ("element of the robot, the best first", ""),
            "levers[].per_cent": (
                "change of the critical depth by 1 % more stiffness of the element, at the same pose",
                "%",
            ),
            "levers[].per_kilogram": (
                "relative change by one kilogram more of an elastic body, and of its stiffness; null for others",
                "1/kg",
            ),
            "advised.speed": (
                "speeds with the highest stable depth at every pose",
                "rpm",
            ),
            "advised.depth": ("lower end of the band there, least over the poses", "m"),
            "process.speed": ("spindle speed of the job", "rpm"),
            "process.depth": ("depth of cut of the job", "m"),
            "process.kt": ("change of the tangential force by the chip's area", "N/m²"),
            "process.chip": ("mean chip thickness", "m"),
            "process.immersed": ("mean number of teeth in the workpiece", ""),
            "process.ripple": (
                "first harmonic of the cutting coefficients over their mean; above 0.1 all harmonics count",
                "1",
            ),
            "path.s": ("length from the start of the path, at each of its points", "m"),
            "path.line": ("line of the path file", ""),
            **within("path", LIMITS),
            "path.stable": ("whether the job's depth is stable at its speed", ""),
        },
    ),
    "path": (
        ["path", "JOB.toml", "--compensate", "--out", "DIR"],
        {
            "job": ("path of the job file", ""),
            "robot": ("name of the robot", ""),
            "points": ("number of points", ""),
            "length": ("path length", "m"),
            "rms": ("rms of the tool's position error", "m"),
            "columns.*": ("[point]: columns of `path.csv` by name", "SI"),
            "worst.line": (
                "line of the path file with the largest error during the process",
                "",
            ),
            "worst.s": ("path length up to this point", "m"),
            "worst.error": ("twist of the tool from its nominal pose", TWIST),
            "worst.size": ("magnitude of the translational error", "m"),
            "worst.normal": (
                "error component normal to the path, to the left seen from the spindle",
                "m",
            ),
            "worst.along": ("error component along the path", "m"),
            "worst.binormal": ("error component perpendicular to both", "m"),
            "worst.bound": (
                "95 % bound on `size` from the error bars of the parts",
                "m",
            ),
            "worst.shares.*": ("share of each element in the strain energy", "1"),
            "worst.drives.*": ("force or torque of each drive", "N, N·m"),
            "worst.stress[].body?": (
                "body, largest von Mises stress first; empty without FEA parts",
                "",
            ),
            "worst.stress[].part?": ("part of this body", ""),
            "worst.stress[].material?": ("material of the part", ""),
            "worst.stress[].von_mises?": (
                "largest, without the elements at clamped or loaded faces",
                "Pa",
            ),
            "worst.stress[].at?": ("position of the largest stress, part axes", "m"),
            "worst.stress[].factor?": (
                "yield strength over `von_mises`; null if the job gives none",
                "1",
            ),
            "frequencies.s": ("[station]: path length of the station", "m"),
            "frequencies.first": (
                "[station]: first natural frequency; null without masses",
                "Hz",
            ),
            **{
                f"process.{name}?": (words, unit)
                for name, words, unit in (
                    ("feed", "mean force on the tool along the path", "N"),
                    ("across", "mean force to the left, seen from the spindle", "N"),
                    ("axial", "mean force along the tool axis", "N"),
                    ("torque", "torque about the tool axis", "N·m"),
                    ("power", "cutting power", "W"),
                    ("speed", "spindle speed", "1/s"),
                    ("tooth_passing", "tooth passing frequency", "1/s"),
                    ("chip", "mean chip thickness", "m"),
                )
            },
            "free.least?": (
                "error to minimize: `normal`, `along`, `binormal` or `size`",
                "",
            ),
            "free.fixed.NAME?": ("best constant value of a free coordinate", "m, rad"),
            **{
                f"free.{which}.{size}?": (f"{size} error, {how}", "m")
                for which, how in (
                    ("single", "best constant values"),
                    ("chosen", "chosen values"),
                )
                for size in ("greatest", "rms")
            },
            "compensated.before?": ("rms error with the original commands", "m"),
            "compensated.after?": (
                "rms residual error of the commanded coordinates after compensation",
                "m, rad",
            ),
            "compensated.largest?": ("largest residual error", "m, rad"),
            "compensated.refused[]?": (
                "points that keep their command: line and reason",
                "",
            ),
        },
    ),
    "element": (
        ["element", "BEARING.toml"],
        {
            "kind": ("kind of the element", ""),
            "stiffness": (
                "[i][j]: at the centre, x along the axis; zero in free directions",
                STIFF,
            ),
            "compliance": (
                "[i][j]: inverse of the stiffness in the constrained directions",
                YIELDS,
            ),
            "free": ("indices (from 0) of the free components x y z rx ry rz", ""),
            "twist": ("twist of the moving side under preload and load", TWIST),
            "loads": ("load on each rolling element", "N"),
            "angles": ("contact angle of each contact to the radial plane", "rad"),
            "source": ("source of the formulas or values", ""),
            "notes": ("limitations of the result, one sentence each", ""),
        },
    ),
    "keys": (
        ["keys", "milling"],
        {
            "*.*": (
                "`key`, `means`, `takes` and `default` of each key, by kind of file and section",
                "",
            ),
        },
    ),
    "campaign new": (
        [
            "campaign",
            "new",
            "five-bar",
            "--out",
            "CAMPAIGN",
            "--ask",
            "base-compliance from actuator-stiffness",
        ],
        {
            "folder": ("path of the folder written", ""),
            "readings": ("number of readings to fill in", ""),
            "poses": ("number of poses", ""),
            "plan.sensors": ("with `--ask`: names of the sensors to read", ""),
            "plan.loads": ("names of the load points to use", ""),
            "plan.enough": (
                "target of the expected ln-odds for each pair of causes",
                "",
            ),
            "plan.pairs[].first": ("`effect @ place` assumed true", ""),
            "plan.pairs[].second": (
                "`effect @ place` it may be confused with, or `no effect`",
                "",
            ),
            "plan.pairs[].ln_odds": (
                "expected ln-odds of the first, minimum over its parameters",
                "",
            ),
            "plan.pairs[].hidden": (
                "parameters of the first that no available reading distinguishes from the second",
                "",
            ),
            "plan.pairs[].larger_pulls": (
                "factor on the pulls that distinguishes those, too; 1 if none are left, null if none does",
                "",
            ),
            "plan.pairs[].asked": ("whether both belong to the question", ""),
        },
    ),
    "campaign check": (
        ["campaign", "check", "CAMPAIGN"],
        {
            "robot": (
                "robot file named in `campaign.toml`; null for a table of predictions",
                "",
            ),
            "readings": ("number of readings", ""),
            "empty": ("number of readings without a value", ""),
            "kinds.*": (
                "number of readings per kind: `deflection`, `deviation`, `stiffness`, …",
                "",
            ),
            "coordinates": ("names of the pose coordinates", ""),
            "poses.*": ("coordinates of each pose", TWIST),
            "sessions.*": ("number of readings per session", ""),
            "without_sigma": ("number of readings without an uncertainty", ""),
            "copies": (
                "list of readings that repeat others exactly, as one line; null: none",
                "",
            ),
            "remarks": (
                "suspicious readings: `doubt`, `instrument` (or load, drive), `where` (files, lines) and `text`",
                "",
            ),
            "channels[].reads": ("sensor, or quantity at M", ""),
            "channels[].kind": ("kind of the readings", ""),
            "channels[].count": ("number of readings", ""),
            "channels[].unit": ("unit of the readings", ""),
            "channels[].low": ("minimum; null without values", "`unit`"),
            "channels[].high": ("maximum", "`unit`"),
            "channels[].sigma": ("median standard uncertainty", "`unit`"),
            "sensors.*": (
                "data of each sensor from `campaign.toml`, and its number of readings",
                "m",
            ),
            "loads.*": ("data of each load point, and its number of readings", "m"),
            "largest_wrench.*": (
                "largest applied value of each wrench component",
                "N, N·m",
            ),
            "responses.*?": (
                "frequency responses of each `[responses.NAME]` beside those of the model (docs/guides/hammer.md)",
                "m, Hz, dB",
            ),
        },
    ),
    "diagnose": (
        ["diagnose", "published", "--out", "DIR"],
        {
            "verdict": (
                "`identified`, `partly`, `ambiguous`, `unexplained` or `no-gap`",
                "",
            ),
            "gap.nominal": ("gap between model and readings", "% rms"),
            "gap.explained": ("remaining gap with the effects", "% rms"),
            "gap.held_out": (
                "remaining gap at held-out poses; null at a single pose",
                "% rms",
            ),
            "gap.noise": ("noise of the readings", "% rms"),
            "gap.chi2_per_reading": (
                "χ² per reading without and with the effects",
                "1",
            ),
            "gap.left": (
                "remaining gap beyond the noise: √(explained² − noise²)",
                "% rms",
            ),
            "gap.discrepancy": (
                "size of an unknown cause in addition to the effects",
                "% of the readings",
            ),
            "gap.unit": ("unit of the gap", ""),
            "gap.absolute.*": (
                (
                    "by kind of reading: `unit` and rms `before`, `after`, `held_out` and "
                    "`noise`; `response`: level of responses, dB; `frequency` and "
                    "`frequency_relative`: of their modes, with `mode ` before the name "
                    "beside readings of frequencies"
                ),
                "`unit`",
            ),
            "effects[].effect": ("name of an identified effect", ""),
            "effects[].place": ("location of the effect", ""),
            "effects[].probability": ("probability that the effect is present", "1"),
            "effects[].gap_after": ("remaining gap with this effect alone", "% rms"),
            "effects[].parameters.*.value": ("fitted value", "`unit`"),
            "effects[].parameters.*.sigma": ("standard uncertainty", "`unit`"),
            "effects[].parameters.*.unit": ("SI unit", ""),
            "effects[].parameters.*.plausible": (
                "whether the value is typical of such robots",
                "",
            ),
            "effects[].parameters.*.interval": ("95 % credible interval", "`unit`"),
            "effects[].parameters.*.nominal": (
                "value in the model; null if it has none",
                "`unit`",
            ),
            "effects[].confused_with": (
                "effects not distinguished by these readings, `effect @ place`; `unknown @ …`: unmodelled",
                "",
            ),
            "effects[].share": (
                "share of the effect in the explained gap (Shapley value)",
                "1",
            ),
            "effects[].group_probability": (
                "probability that it or one of `confused_with` is present",
                "1",
            ),
            "effects[].errors": (
                "what `parameters` summarize: small errors, largest first; mass and place where moments show",
                "`unit`; angles as arc length at 1 m",
            ),
            "responses.*.modes[].measured?": (
                "of each set-up of frequency responses: measured natural frequency",
                "Hz",
            ),
            "responses.*.modes[].before?": (
                "frequency of the nominal model's mode of the same shape; null without one",
                "Hz",
            ),
            "responses.*.modes[].after?": ("the same with the effects found", "Hz"),
            "responses.*.modes[].zeta?": ("damping ratio fitted with these", "1"),
            "responses.*.modes[].mac_before?": (
                "MAC of the measured and the nominal model's shape at the points",
                "1",
            ),
            "responses.*.modes[].mac_after?": ("the same with the effects found", "1"),
            "responses.*.before?": (
                "rms difference of measured and predicted levels",
                "dB",
            ),
            "responses.*.after?": ("the same with the effects found", "dB"),
            "responses.*.noise?": ("the same by noise alone", "dB"),
            "drives.*.stated?": (
                "stiffness of each drive in the robot file",
                "N/m, N·m/rad",
            ),
            "drives.*.value?": (
                "resulting stiffness with everything that was found, set and member multiplied out",
                "N/m, N·m/rad",
            ),
            "drives.*.sigma?": (
                "its standard uncertainty; null if the drive is not seen",
                "N/m, N·m/rad",
            ),
            "drives.*.seen?": ("whether the readings show the drive", ""),
            "beside": (
                "uncertain effects fitted together with the others, as in `effects`; `unknown`: unmodelled",
                "",
            ),
            "alternatives[].effect": ("effect considered but not identified", ""),
            "alternatives[].place": ("location of the effect", ""),
            "alternatives[].probability": (
                "probability that the effect is present",
                "1",
            ),
            "alternatives[].gap_after": (
                "remaining gap with this effect alone",
                "% rms",
            ),
            "alternatives[].why_not": ("reason for rejection", ""),
            "possible": (
                "possible effects, each with `effect`, `place`, `probability`",
                "",
            ),
            "where.direction.*": ("share of each direction in the gap", "1"),
            "where.component": (
                "share of each component in the gap; empty without a mechanism",
                "1",
            ),
            "where.sensor.*": ("share of each sensor, or axis at M, in the gap", "1"),
            "where.left": (
                "remaining gap by direction; empty if it is at the noise",
                "1",
            ),
            "where.left_by_sensor": ("remaining gap by sensor", "1"),
            "where.poses": ("names of the poses", ""),
            "where.rows": ("file and line of the first reading at each pose", ""),
            "where.pose": (
                "[pose][x y z rx ry rz]: rms of the residuals; null without readings",
                "σ",
            ),
            "where.unexplained": (
                "rms of the residuals with the effects, as in `where.pose`",
                "σ",
            ),
            "next_measurement": (NEXT, "m, rad; N, N·m"),
            "why_no_next": (
                "why no reading is proposed for causes not distinguished; else empty",
                "",
            ),
            "remarks": ("further remarks, one sentence each", ""),
            "sensitivity[].prior": (
                "prior quantity that is multiplied or divided by ten",
                "",
            ),
            "sensitivity[].verdict": ("verdict with this prior", ""),
            "sensitivity[].probability.*": (
                "probability of each identified effect with this prior",
                "1",
            ),
            "held_out_check": (
                "held-out readings: `inside_95`, share within their 95 % interval; `chi2_per_reading`",
                "1",
            ),
        },
    ),
    "blind": (
        ["blind", "serial-arm", "--campaigns", "1", "--out", "DIR"],
        {
            "campaigns": ("number of campaigns per robot", ""),
            "seed": ("random seed", ""),
            "machine": ("whose mechanics was measured: `own` or `exudyn`", ""),
            "seconds": ("wall time", "s"),
            **SHARES,
            "held_out_over_noise": (
                "largest ratio of held-out gap to noise among correctly identified campaigns",
                "1",
            ),
            "calibration[].stated": (
                "mean stated probability in each tenth of 0 to 1",
                "1",
            ),
            "calibration[].true": ("share of true effects among them", "1"),
            "calibration[].count": ("number of probabilities", ""),
            **within("robots.*", SHARES),
            "confusion.planted": ("single planted effects: rows of `counts`", ""),
            "confusion.answered": ("diagnosed effects: columns of `counts`", ""),
            "confusion.counts": ("number of campaigns", ""),
            "outcomes[].robot": ("robot of the campaign", ""),
            "outcomes[].campaign": ("campaign number", ""),
            "outcomes[].kind": ("`single`, `pair`, `triple`, `none` or `outside`", ""),
            "outcomes[].measured": (
                "`tool`: readings at M; `sensors`: gauges and a hook; `sag`",
                "",
            ),
            "outcomes[].truth": ("planted effects, `effect @ place`", ""),
            "outcomes[].left_out": ("effect removed from the library; null: none", ""),
            "outcomes[].imitated": (
                "effect outside the library: whether three known effects reproduce its readings",
                "",
            ),
            "outcomes[].redrawn": (
                "effects drawn before, with which EXUDYN found no equilibrium",
                "",
            ),
            "outcomes[].verdict": ("verdict of the diagnosis", ""),
            "outcomes[].named": ("diagnosed effects", ""),
            "outcomes[].confused_with": (
                "effects not distinguished from each of them",
                "",
            ),
            "outcomes[].right": ("whether the diagnosis is correct", ""),
            "outcomes[].evidence": (
                "ln-odds of the best hypothesis against no effect",
                "1",
            ),
            "outcomes[].gap.*": (
                "`nominal`, `explained`, `held_out`, `noise`",
                "% rms",
            ),
            "outcomes[].covered": (
                "for each correctly identified parameter: whether its 95 % interval contains the true value",
                "",
            ),
        },
    ),
    "audit": (
        ["audit"],
        {
            "[].source": ("equation or table of the paper", ""),
            "[].entry": ("name of the number", ""),
            "[].published": ("printed value", "SI; RMS in %"),
            "[].as_published": (
                "value from the paper's equations as printed; null if they give none",
                "SI; RMS in %",
            ),
            "[].correct": ("correct value", "SI; RMS in %"),
            "[].bound": ("upper bound for any Biglide; null if there is none", "SI"),
            "[].verdict": ("verdict in words", ""),
        },
    ),
    "cache": (
        ["cache"],
        {
            "folder": ("cache folder", ""),
            "kinds.*.entries": ("number of results of this kind", ""),
            "kinds.*.bytes": ("total size", "bytes"),
        },
    ),
    "cache list": (
        ["cache", "list"],
        {
            "[].kind": ("kind of result", ""),
            "[].key": ("hash of all inputs", ""),
            "[].bytes": ("size", "bytes"),
            "[].made": ("creation time, seconds since 1970", "s"),
        },
    ),
    "cache clear": (
        ["cache", "clear", "--kind", "moved"],
        {
            "folder": ("cache folder", ""),
            "entries": ("number of results removed", ""),
            "bytes": ("total size", "bytes"),
        },
    ),
}
