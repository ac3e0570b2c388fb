"""An independent second derivation: the total potential energy of any mechanism at finite motions, and its Hessian.

Every node moves by six coordinates of its own from where the unloaded mechanism has it; elastic bodies store energy
by their coordinates Tx Ty Tz Rx Ry Rz, drives and the bearings of balls by theirs, joints constrain by Lagrange
multipliers. Gradients come from complex steps. Of the library only the description of a mechanism is used.
"""

import numpy as np

EPS = 1e-30
SCALE = 1e9  # of constraint errors, near that of stiffnesses: without it their common system loses six digits
HELD = {"prismatic": (1, 2), "cylindrical": (1, 2), "planar": (0,)}


def _t(a):
    return np.swapaxes(a, -1, -2)


def _turn(rho):
    s = np.zeros((*rho.shape[:-1], 3, 3), dtype=rho.dtype)
    s[..., 0, 1] = -rho[..., 2]
    s[..., 0, 2] = rho[..., 1]
    s[..., 1, 2] = -rho[..., 0]
    s = s - _t(s)
    return np.eye(3) + s + s @ s / 2 + s @ s @ s / 6 + s @ s @ s @ s / 24


class Potential:
    """``bodies``: the unloaded mechanism of ``tests.vjm.oracle``, at its pose."""

    def __init__(self, bodies):
        self.m = bodies.m
        self.bodies = bodies
        self.nodes = [n for b in self.m.bodies for n in b.nodes]
        self.size = 6 * len(self.nodes)
        r, p = bodies.of(self.m.tool.body)
        self.centre = r @ self.m.tool.at + p
        at = self.nodes.index(self.m.tool.body)
        self.tool = np.arange(6 * at, 6 * at + 6)

    def energy_and_constraints(self, z):  # noqa: C901, PLR0912
        """Energy (...) and constraint errors times ``SCALE`` (..., k) of coordinates z (..., size)."""
        moved = {
            "ground": (
                np.eye(3) + 0 * z[..., :1, None],
                0 * z[..., :3],
                np.eye(3),
                np.zeros(3),
            )
        }
        for k, node in enumerate(self.nodes):
            r, p = self.bodies.of(node)
            u = z[..., 6 * k : 6 * k + 6]
            moved[node] = (_turn(u[..., 3:]), u[..., :3], r, p)

        def place(node, home):
            turn, v, r, p = moved[node]
            return self.centre + v + (turn @ (r @ home + p - self.centre))

        def axes(node, home):
            turn, _, r, _ = moved[node]
            return turn @ (r @ home)

        energy = 0.0 * z[..., 0]
        errors = []
        for b in self.m.bodies:
            points = [(b.nodes[0], b.centre, b.mass)]
            if b.elastic is not None:
                e = b.elastic
                inward = (
                    np.zeros(3) if e.dynamics is None else (e.tip - e.base) / 6
                )  # of a uniform beam's weight
                points = [
                    (b.nodes[0], e.base + inward, b.mass / 2),
                    (b.nodes[1], e.tip - inward, b.mass / 2),
                ]
                first = axes(b.nodes[0], e.axes)
                second = axes(b.nodes[1], e.axes)
                gap = place(b.nodes[1], e.tip) - place(b.nodes[0], e.tip)
                t = _t(first) @ second
                angles = [
                    np.arctan(-t[..., 1, 2] / t[..., 2, 2]),
                    np.arcsin(t[..., 0, 2]),
                ]
                angles.append(np.arctan(-t[..., 0, 1] / t[..., 0, 0]))
                theta = np.concatenate(
                    [(_t(first) @ gap[..., None])[..., 0], np.stack(angles, -1)], -1
                )
                theta = theta - (0.0 if e.offset is None else e.offset)
                energy = energy + 0.5 * np.einsum(
                    "...i,ij,...j->...", theta, np.linalg.inv(e.compliance), theta
                )
            for node, at, mass in points:
                if mass:
                    energy = energy - mass * place(node, at) @ self.m.gravity
        for j in self.m.joints:
            first = axes(j.first, j.axes)
            second = axes(j.second, j.axes)
            gap = (
                _t(first) @ (place(j.second, j.at) - place(j.first, j.at))[..., None]
            )[..., 0]
            if (
                j.kind == "spherical" and j.compliance is not None
            ):  # its bearing yields in place of what it would hold
                yielding = np.linalg.inv(j.compliance[:3, :3])
                energy = energy + 0.5 * np.einsum(
                    "...i,ij,...j->...", gap, yielding, gap
                )
                continue
            errors += [gap[..., k] for k in HELD.get(j.kind, (0, 1, 2))]
            dots = _t(first) @ second
            if j.kind in ("fixed", "prismatic"):
                errors += [dots[..., 1, 0], dots[..., 2, 0], dots[..., 2, 1]]
            elif j.kind in ("revolute", "cylindrical", "planar"):
                errors += [dots[..., 1, 0], dots[..., 2, 0]]
            elif j.kind == "universal":
                a = axes(j.first, j.axis[:, None])
                b = axes(j.second, j.axis2[:, None])
                errors.append((_t(a) @ b)[..., 0, 0] - j.axis @ j.axis2)
            if j.spring is not None:
                energy = energy + 0.5 * j.spring * self._displacement(j, axes, gap)
            if j.drive is not None and j.kind == "revolute":
                (r1, _), (r2, _) = self.bodies.of(j.first), self.bodies.of(j.second)
                rest = (r1 @ j.axes).T @ (r2 @ j.axes)  # where the drive holds it
                t = dots @ rest.T
                energy = (
                    energy
                    + 0.5
                    * j.drive.stiffness
                    * np.arctan(t[..., 2, 1] / t[..., 1, 1]) ** 2
                )
            elif j.drive is not None:
                (r1, p1) = self.bodies.of(j.first)
                (r2, p2) = self.bodies.of(j.second)
                rest = (r1 @ j.axes[:, 0]) @ (r2 @ j.at + p2 - r1 @ j.at - p1)
                energy = energy + 0.5 * j.drive.stiffness * (gap[..., 0] - rest) ** 2
        return energy, SCALE * np.stack(errors, -1)

    def _displacement(self, j, axes, gap):
        """Sum of the squares of a joint's free motions from the rest of its spring; ``gap`` in its own axes."""
        first = axes(j.first, np.eye(3))
        second = axes(j.second, np.eye(3))
        if j.kind == "prismatic":
            return (gap[..., 0] - j.rest) ** 2
        r = _t(first) @ second
        if j.kind == "spherical":  # φ² of the rotation's trace and skew part
            s = (
                np.stack(
                    [
                        r[..., 2, 1] - r[..., 1, 2],
                        r[..., 0, 2] - r[..., 2, 0],
                        r[..., 1, 0] - r[..., 0, 1],
                    ],
                    -1,
                )
                / 2
            )
            c = (r[..., 0, 0] + r[..., 1, 1] + r[..., 2, 2] - 1.0) / 2
            t = (s * s).sum(
                axis=-1
            ) / c**2  # tan² φ; φ² = t (atan(√t)/√t)², as a series where it is small
            root = np.sqrt(t)
            return np.where(
                np.abs(t) > 1e-4,
                np.arctan(root) ** 2,
                t - 2 / 3 * t**2 + 23 / 45 * t**3 - 44 / 105 * t**4,
            )

        def about(axis, a, b):  # angle about ``axis`` from a to b, both vectors
            a = a - axis * (a @ axis)[..., None]
            b = b - axis * (b @ axis)[..., None]
            return np.arctan((np.cross(a, b) @ axis) / (a * b).sum(axis=-1))

        if j.kind == "revolute":
            y = np.broadcast_to(j.axes[:, 1], r.shape[:-1])
            return (about(j.axis, y, r @ j.axes[:, 1]) - j.rest) ** 2
        one = np.broadcast_to(j.axis, r.shape[:-1])
        two = np.broadcast_to(j.axis2, r.shape[:-1])
        return (
            about(j.axis, two, r @ j.axis2) ** 2
            + about(j.axis2, _t(r) @ j.axis, one) ** 2
        )

    def gradient(self, z, multipliers):
        energy, errors = self.energy_and_constraints(
            z[..., None, :] + 1j * EPS * np.eye(self.size)
        )
        jacobian = _t(errors.imag / EPS)
        return energy.imag / EPS + multipliers @ jacobian, jacobian

    def hessian(self, z, multipliers, step=1e-5):
        out = np.empty((self.size, self.size))
        for k in range(self.size):
            d = np.zeros(self.size)
            d[k] = step
            out[k] = (
                self.gradient(z + d, multipliers)[0]
                - self.gradient(z - d, multipliers)[0]
            ) / (2 * step)
        return 0.5 * (out + out.T)

    def tangent_stiffness(self, iterations=6):
        """Stiffness (6, 6) at the loaded equilibrium, at the tool point, and its sag (6,)."""
        z = np.zeros(self.size)
        count = self.energy_and_constraints(z)[1].shape[-1]
        multipliers = np.zeros(count)

        def system():
            _, jacobian = self.gradient(z, multipliers)
            return np.block(
                [
                    [self.hessian(z, multipliers), jacobian.T],
                    [jacobian, np.zeros((count, count))],
                ]
            )

        inverse = np.linalg.inv(system())
        for _ in range(iterations):
            gradient, _ = self.gradient(z, multipliers)
            step = -inverse @ np.concatenate(
                [gradient, self.energy_and_constraints(z)[1]]
            )
            z = z + step[: self.size]
            multipliers = multipliers + step[self.size :]
        kkt = system()
        inner = np.setdiff1d(np.arange(len(kkt)), self.tool)
        coupling = kkt[np.ix_(inner, self.tool)]
        k = kkt[np.ix_(self.tool, self.tool)] - coupling.T @ np.linalg.solve(
            kkt[np.ix_(inner, inner)], coupling
        )
        return by_angular_velocity(k, z[self.tool]), z[self.tool]


def by_angular_velocity(stiffness, sag):
    """A stiffness (6, 6) whose rotations are those of a rotation vector, here that of ``sag`` (6,), in base axes."""
    spin = np.cross(
        np.eye(3), sag[3:]
    )  # rate of the rotation vector per angular velocity: I - S/2 + S²/12
    chart = np.block(
        [
            [np.eye(3), np.zeros((3, 3))],
            [np.zeros((3, 3)), np.eye(3) - spin / 2 + spin @ spin / 12],
        ]
    )
    return chart.T @ stiffness @ chart
