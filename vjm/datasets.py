"""Results with names: as a dataset of xarray, and as a table of pandas with a row a pose."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.runtime.brief import describe_briefly
from stiffscope.vjm.mechanism import COORDINATES

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import pandas as pd  # pyright: ignore[reportMissingTypeStubs]
    import xarray as xr

    from stiffscope.vjm.kinematics import Configurations

POSE = "pose"
WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")


class Labelled(ABC):
    """A result at n poses that has names for its axes, and a short account of itself."""

    __repr__ = describe_briefly

    @abstractmethod
    def to_xarray(self) -> xr.Dataset:
        """Return the numbers with names along pose, twist (x y z rx ry rz) and wrench, units in their attributes."""

    def to_pandas(self) -> pd.DataFrame:
        """Return a row for each pose; a column for each number, named after its place: `stiffness_fx_x`."""
        import pandas as pd  # pyright: ignore[reportMissingTypeStubs]

        dataset: Any = self.to_xarray()
        columns: dict[str, Any] = {
            name: each.to_numpy() for name, each in dataset.coords.items() if each.dims == (POSE,)
        }
        for name, values in dataset.data_vars.items():
            rest = [dim for dim in values.dims if dim != POSE]
            flat = values.transpose(POSE, *rest).to_numpy()
            for place in np.ndindex(flat.shape[1:]):
                words = [str(dataset[dim].to_numpy()[k]) for dim, k in zip(rest, place, strict=True)]
                columns["_".join([name, *words])] = flat[(slice(None), *place)]
        return pd.DataFrame(columns)


def make_dataset(
    found: Configurations, variables: Mapping[str, tuple[Sequence[str], Any, str]], **names: Sequence[Any]
) -> xr.Dataset:
    """Return results at configurations as a dataset.

    Parameters
    ----------
    found
        Configurations at the n poses.
    variables
        Dimensions, values and unit of each variable; "m, rad" stands for the twist's or wrench's two units.
    names
        Names along dimensions other than pose, twist and wrench.

    """
    import xarray as xr

    pose = found.mechanism.tool.pose
    places = {
        name: (POSE, found.poses[:, k], {"units": "rad" if name.startswith("r") else "m"})
        for k, name in enumerate(pose)
    }
    axes = {"twist": COORDINATES, "wrench": WRENCH, **names}
    used = {dim for dims, _, _ in variables.values() for dim in dims}
    return xr.Dataset(
        {name: (tuple(dims), np.asarray(values), {"units": unit}) for name, (dims, values, unit) in variables.items()},
        places | {dim: list(each) for dim, each in axes.items() if dim in used},
        {"axes": "base axes, at M", "source": "stiffscope"},
    )
