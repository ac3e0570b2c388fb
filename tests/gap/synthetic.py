"""A forward model whose readings are linear in its effects: exact answers are at hand, and it costs nothing."""

from dataclasses import dataclass

import numpy as np

from stiffscope.gap.campaign.campaign import Campaign
from stiffscope.gap.forward.forward_model import Candidate, Displaced, Noise, Trial


@dataclass(frozen=True)
class LinearPrediction:
    values: np.ndarray
    signatures: dict

    def columns(self, candidate):
        return self.signatures[candidate.name][:, : len(candidate.scale)]

    def step(self, _):
        return np.zeros(len(self.values))


@dataclass(frozen=True)
class LinearModel:
    campaign: Campaign
    nominal: np.ndarray
    signatures: dict
    """(n, k) by `effect @ place`, in the readings' units."""
    library: tuple
    most_effects: int = 5
    tried: tuple = ()
    coarse: None = None

    def admits(self, candidates):
        return len({c.name for c in candidates}) == len(candidates)

    def predict(self, parameters=()):
        changes = (
            self.signatures[c.name][:, : len(values)] @ np.array(values)
            for c, values in parameters
        )
        return LinearPrediction(
            self.nominal + sum(changes, np.zeros(len(self.nominal))), self.signatures
        )

    def doubt_again(self, parameters):
        del parameters

    def find_equilibria(self, parameters, rest=None):
        del parameters, rest

    def noise(self):
        n = len(self.nominal)
        return Noise(
            np.array(self.campaign.sigma),
            np.ones(n, bool),
            np.zeros(n, bool),
            np.ones(1),
        )

    def trial(self, sigma):
        return Trial(self, sigma, np.arange(len(self.campaign)))

    def find_displaced(self, _=()):
        return Displaced()

    def remarks(self, *_):
        return ()


def linear_model(
    rng, poses=10, loads=8, effects=20, parameters=(1, 2, 3), sigma=1e-6, rough=0.05
):
    """Deflections of about 20 sigma under loads at poses, and effects that change each of them smoothly over the poses.

    Nothing is planted yet: the readings are the nominal ones with noise.
    """
    n = poses * loads * 6
    pose, load, axis = (
        v.ravel()
        for v in np.meshgrid(
            np.arange(poses), np.arange(loads), np.arange(6), indexing="ij"
        )
    )
    nominal = (
        20.0
        * sigma
        * rng.standard_normal((loads, 6))[load, axis]
        * (1.0 + 0.3 * np.sin(pose + axis))
    )
    library = []
    signatures = {}
    for k in range(effects):
        count = parameters[k % len(parameters)]
        name = f"effect-{k} @ place"
        smooth = rng.standard_normal((3, loads, 6, count))
        angle = 2.0 * np.pi * pose / poses
        shape = smooth[0, load, axis] + np.sin(angle)[:, None] * smooth[1, load, axis]
        shape = (
            shape
            + np.cos(angle)[:, None] * smooth[2, load, axis]
            + rough * rng.standard_normal((n, count))
        )
        signatures[name] = 10.0 * sigma * shape
        names = tuple(f"p{i}" for i in range(count))
        wide = ((-100.0, 100.0),) * count
        library.append(
            Candidate(
                f"effect-{k}", "place", names, ("1",) * count, (1.0,) * count, wide
            )
        )
    campaign = Campaign(
        robot="synthetic",
        modelled=(),
        components="fea",
        pose_names=tuple(f"P{k}" for k in range(poses)),
        poses=np.column_stack([np.arange(poses), np.zeros(poses), np.zeros(poses)]),
        pose=pose,
        wrench=np.eye(max(loads, 6))[load][:, :6] * (1.0 + load // 6)[:, None],
        quantity=axis,
        value=nominal + sigma * rng.standard_normal(n),
        sigma=np.full(n, sigma),
        session_names=("",),
        session=np.zeros(n),
        files=("readings.csv",),
        file=np.zeros(n),
        line=np.arange(n) + 2,
    )
    return LinearModel(campaign, nominal, signatures, tuple(library))
