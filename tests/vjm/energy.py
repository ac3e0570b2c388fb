"""An independent second derivation: the Biglide's total potential energy, finite motions and all, and its Hessian.

Every joint coordinate is explicit (69 unknowns with the platform), the six chains close on the platform by Lagrange
multipliers, gradients come from complex steps. Nothing of the library is used.
"""

import numpy as np

EPS = 1e-30


def _rotate(axis, angle):
    c = np.cos(angle)
    s = np.sin(angle)
    one = np.ones_like(angle)
    zero = np.zeros_like(angle)
    rows = {
        0: [[one, zero, zero], [zero, c, -s], [zero, s, c]],
        1: [[c, zero, s], [zero, one, zero], [-s, zero, c]],
        2: [[c, -s, zero], [s, c, zero], [zero, zero, one]],
    }[axis]
    return np.stack([np.stack(r, -1) for r in rows], -2)


class Biglide:
    """Coordinates z: stage, per limb (drive, slider 6), per link (q_A, spring 6, q_B), platform (v, ρ)."""

    def __init__(
        self, geometry, link, slider, drive, link_mass, platform_mass, q, gravity
    ):
        self.g = geometry
        self.q = q
        self.gravity = gravity
        self.link_k = np.linalg.inv(link)
        self.drive = drive
        turn = np.diag([-1.0, -1.0, 1.0, -1.0, -1.0, 1.0])
        self.slider_k = [np.linalg.inv(slider), np.linalg.inv(turn @ slider @ turn)]
        self.link_mass = link_mass
        self.platform_mass = platform_mass
        self.size = 69

    def energy_and_closure(self, z):
        """Energy (...) in J and closure errors (..., 36) of coordinates z (..., 69)."""
        g = self.g
        q = self.q
        energy = (
            0.5 * self.drive * z[..., 0] ** 2
            - self.platform_mass * self.gravity * z[..., 65]
        )
        rho = z[..., 66:69]
        s = np.zeros((*z.shape[:-1], 3, 3), dtype=z.dtype)
        s[..., 0, 1] = -rho[..., 2]
        s[..., 0, 2] = rho[..., 1]
        s[..., 1, 2] = -rho[..., 0]
        s = s - np.swapaxes(s, -1, -2)
        plat_r = np.eye(3) + s + s @ s / 2 + s @ s @ s / 6 + s @ s @ s @ s / 24
        closures = []
        for i, side in ((0, 1.0), (1, -1.0)):
            at = 1 + 7 * i
            energy = energy + 0.5 * self.drive * z[..., at] ** 2
            theta = z[..., at + 1 : at + 7]
            energy = energy + 0.5 * np.einsum(
                "...i,ij,...j->...", theta, self.slider_k[i], theta
            )
            reach = g.L * np.array([side * np.cos(q), 0, np.sin(q)])
            a_point = np.array([-side * g.l, 0, -g.l2]) - reach
            r, p = self._move(
                np.broadcast_to(np.eye(3), (*z.shape[:-1], 3, 3)),
                a_point + z[..., :1] * [0, 1, 0] + z[..., at : at + 1] * [1, 0, 0],
                theta,
            )
            feet = ([-side * g.h, 0, 0], [side * g.h, g.d, 0], [side * g.h, -g.d, 0])
            angle = -q if i == 0 else q - np.pi
            for j, foot in enumerate(feet):
                energy, closure = self._chain(
                    z, energy, r, p, np.array(foot), angle, 15 + 8 * (3 * i + j)
                )
                base = np.array([-side * g.l, 0, -g.l2]) + foot
                tip_r, tip_p = (
                    closure  # of the end body, whose zero position has B_ij at base
                )
                plat_p = z[..., 63:66] + np.einsum("...ij,j->...i", plat_r, base)
                gap_r = np.swapaxes(plat_r, -1, -2) @ tip_r
                skewed = gap_r - np.swapaxes(gap_r, -1, -2)
                turn = 0.5 * np.stack(
                    [skewed[..., 2, 1], skewed[..., 0, 2], skewed[..., 1, 0]], -1
                )
                closures += [tip_p - plat_p, turn]
        return energy, np.concatenate(closures, -1)

    @staticmethod
    def _move(r, p, theta):
        p = p + np.einsum("...ij,...j->...i", r, theta[..., :3])
        for axis in range(3):
            r = r @ _rotate(axis, theta[..., 3 + axis])
        return r, p

    def _chain(self, z, energy, r, p, foot, angle, at):
        theta = z[..., at + 1 : at + 7]
        energy = energy + 0.5 * np.einsum(
            "...i,ij,...j->...", theta, self.link_k, theta
        )
        p = p + np.einsum("...ij,j->...i", r, foot)
        home = _rotate(1, np.array(angle))
        r = r @ _rotate(1, z[..., at]) @ home
        weight = self.link_mass * self.gravity
        along = np.array([self.g.L, 0.0, 0.0])
        energy = (
            energy - weight * (p + np.einsum("...ij,j->...i", r, along / 2))[..., 2]
        )
        r, p = self._move(r, p + np.einsum("...ij,j->...i", r, along), theta)
        return energy, (r @ _rotate(1, z[..., at + 7]) @ home.T, p)

    def gradient(self, z, multipliers):
        """Gradient (..., 69) of the Lagrangian and Jacobian (..., 36, 69) of the closures, by complex steps."""
        energy, closure = self.energy_and_closure(
            z[..., None, :] + 1j * EPS * np.eye(self.size)
        )
        jacobian = np.swapaxes(closure.imag / EPS, -1, -2)
        return energy.imag / EPS + multipliers @ jacobian, jacobian

    def hessian(self, z, multipliers, step=1e-5):
        steps = step * np.eye(self.size)
        ahead, _ = self.gradient(z + steps, multipliers)
        behind, _ = self.gradient(z - steps, multipliers)
        h = (ahead - behind) / (2 * step)
        return 0.5 * (h + h.T)


def tangent_stiffness(robot, iterations=4):
    """Stiffness (6, 6) at the loaded equilibrium, and the platform's sag (6,)."""
    z = np.zeros(robot.size)
    multipliers = np.zeros(36)
    for _ in range(iterations):
        gradient, jacobian = robot.gradient(z, multipliers)
        _, closure = robot.energy_and_closure(z)
        kkt = np.block(
            [
                [robot.hessian(z, multipliers), jacobian.T],
                [jacobian, np.zeros((36, 36))],
            ]
        )
        step = np.linalg.solve(kkt, -np.concatenate([gradient, closure]))
        z = z + step[: robot.size]
        multipliers = multipliers + step[robot.size :]
    _, jacobian = robot.gradient(z, multipliers)
    kkt = np.block(
        [[robot.hessian(z, multipliers), jacobian.T], [jacobian, np.zeros((36, 36))]]
    )
    tool = np.arange(63, 69)
    inner = np.setdiff1d(np.arange(len(kkt)), tool)
    coupling = kkt[np.ix_(inner, tool)]
    return kkt[np.ix_(tool, tool)] - coupling.T @ np.linalg.solve(
        kkt[np.ix_(inner, inner)], coupling
    ), z[tool]
