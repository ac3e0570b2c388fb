"""A small serial arm as a robot file: three revolute joints about z, y and y, with masses."""

AXES = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (0.0, 1.0, 0.0))


def describe_arm(name, masses, centres, points, stiffness, tool):
    """Return the text of the file: three links in kg and m, drives in N·m/rad, gravity along -z."""
    lines = [f'name = "{name}"']
    for k in range(3):
        first = f"link{k}" if k else "ground"
        lines += [
            f"[bodies.link{k + 1}]",
            f'mass = "{float(masses[k])} kg"',
            f"centre = {[float(v) for v in centres[k]]}",
            f"[joints.J{k + 1}]",
            f'between = ["{first}", "link{k + 1}"]',
            'type = "revolute"',
            f"at = {[float(v) for v in points[k]]}",
            f"axis = {list(AXES[k])}",
            f'drive = {{ stiffness = "{float(stiffness[k])} N*m/rad" }}',
        ]
    lines += [
        "[tool]",
        'body = "link3"',
        f"at = {[float(v) for v in tool]}",
        'pose = ["x", "y", "z"]',
        "[gravity]",
        "acceleration = 9.81",
        "direction = [0, 0, -1]",
    ]
    return "\n".join(lines) + "\n"
