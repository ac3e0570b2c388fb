"""Constants of the inference, stage by stage: value, unit and reason of each."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class VerdictSettings:
    """When an effect is certain, and when a search identifies one."""

    majority: float = 0.5
    """Probability: least of no gap, and of known effects in a group."""
    few: int = 3
    """Readings per parameter: fewer identify nothing."""
    possible: float = 0.02
    """Probability: least of an effect listed as possible."""
    mentioned: int = 3
    """Patterns: most mentioned as substitutes of an effect."""
    explains: float = 0.05
    """Part of the gap beyond the noise: an effect without which no more than this is left is not
    certain, whatever its probability. Errors of a model are of this size."""
    unlisted: float = 0.5
    """Probability: of a cause outside the vocabulary once no known effect explains the gap."""
    alike: float = 4.0
    """χ²: two standard deviations, within which two causes fit the readings alike."""
    listed: int = 6
    """Effects: most of a group that readings cannot tell apart; beyond, the group says nothing."""


VERDICT = VerdictSettings()


@dataclass(frozen=True)
class EvidenceSettings:
    """How evidence is computed."""

    discrepancies: tuple[float, ...] = (1e-3, 10**-2.5, 1e-2, 10**-1.5, 1e-1)
    """Sizes relative to the readings of an unknown cause beside the effects: below lies the noise
    of most campaigns, beyond an effect that would show."""
    parallel: float = 1e-12
    """Squared length relative to the longest below which two features of a group are one:
    rounding."""
    rounding: float = 1e-12
    """Regularization of inner products, relative: keeps them definite beside rounding."""
    sweeps: int = 2
    """Over the effects, to choose their prior scales: a third changes nothing."""
    negligible: float = 1e-9
    """Probability of a setting of the errors that is left out of covariances."""


EVIDENCE = EvidenceSettings()


@dataclass(frozen=True)
class FitSettings:
    """Prior of sets of effects, and how they are fitted."""

    odds: float = 0.25
    """Odds of one effect more, shared by the words of the vocabulary and by their places: most
    machines have few faults."""
    guessed: float = 10.0
    """Odds that values which the robot file states as guesses differ: that none does is the
    exception."""
    unknown: float = 0.1
    """Of the odds of an effect: those of an unknown cause, shared by the kinds of patterns and
    their places."""
    strange: float = 0.01
    """Of the odds of an effect: those of parameters beyond what is plausible."""
    margin: float = 30.0
    """Ln-odds behind the best to first order up to which a set is fitted,"""
    doubt: float = 0.2
    """or this share of the best one's gain, since first order errs by a share of it."""
    curved: float = 0.1
    """Relative error of the linear prediction beyond which derivatives are taken anew."""
    sizes: tuple[float, ...] = tuple(10.0 ** (0.75 * k) for k in range(-4, 5))
    """Sizes of effects in units of their own: six decades, since mechanics has no favourite
    size."""
    steps: int = 12
    """Most steps of Levenberg and Marquardt."""
    converged: float = 1e-3
    """Of the cost, χ² with that of the prior: a step that lowers it by less is not taken,"""
    settled: float = 0.05
    """and one by less than this is the last."""
    repeated: int = 4
    """Most descents more, each in the sizes that the one before makes the likeliest."""
    alike: float = 0.5
    """Ln of the ratio of two sizes below which descents in both find the same."""
    damping: tuple[float, ...] = (0.0, 0.1, 1.0, 10.0, 100.0)
    """Of the diagonal of the precision: added in turn to damp a step that would raise the cost."""
    far: float = 4.0
    """Largest squared distance of a mean from the linearization, in squared standard deviations."""
    slight: float = 1.0
    """Decrease of the cost, expected or by a damped step, that does not justify more damping."""
    rounding: float = 1e-12
    """Regularization of inner products, relative: prior and noise may differ by more."""
    near: float = 1.1
    """χ² per reading of the nominal model up to which a search needs no start from a coarser one."""


FIT = FitSettings()


@dataclass(frozen=True)
class SearchSettings:
    """How wide the search for sets of effects is: time against sets that are missed."""

    width: int = 10
    """Best hypotheses of each size that are extended,"""
    width_plain: int = 4
    """and best without a discrepancy, which may absorb joint effects."""
    fitted: int = 10
    """Most nonlinear fits for each size (twice as many for single effects),"""
    fitted_plain: int = 6
    """and the best without a discrepancy."""
    least_fitted: int = 4
    """Fits for each size whatever first order says."""
    swapped: int = 4
    """Most substitutes fitted for each effect of the best set."""
    strikes: int = 2
    """Most fits of a size that a flexible effect may end at the assemblable limit."""
    obvious: int = 2
    """Simple effects that are reliably found one by one."""
    wide: tuple[int, int] = (24, 8)
    """Sets of simple effects extended to first order, alone and with others,"""
    sketched: int = 4
    """and sets that are fitted."""
    rounds: int = 3
    """Of exchanging and growing."""
    rivals: int = 3
    """Best sets in which effects are exchanged,"""
    close: float = 3.0
    """within this ln-odds of the best."""
    share: float = 0.5
    """Of the readings: most parameters where the noise is found with the effects, as the rest must
    tell it."""
    gain: float = 1.0
    """Least ln-odds gained by another effect to continue."""
    seeded: int = 12
    """Most hypotheses of a coarser model from which a search starts,"""
    seeded_within: float = 100.0
    """within this ln-odds of its best,"""
    seeded_least: int = 4
    """and regardless of that."""
    comparable: float = 0.1
    """Rms of the estimated second order over the rest that first order leaves, below which another
    cause leaves it; equilibria would take ten times as long and leave the rest as it is."""


SEARCH = SearchSettings()


@dataclass(frozen=True)
class GroupSettings:
    """Which effects readings cannot distinguish."""

    confident: float = 0.9
    """Least probability of a certain effect or group, by the format of the answer."""
    confused: int = 2
    """Other effects listed as indistinguishable, unless more make the group certain."""
    competing: float = 0.02
    """Least probability of a competing hypothesis over that of the best."""
    imitating: float = 3.0
    """Most ln evidence behind the best set to mention a pattern."""
    near: float = 40.0
    """Ln-odds within which another prior may change the order."""


GROUPS = GroupSettings()


@dataclass(frozen=True)
class FitTestSettings:
    """Tests of residuals against the noise."""

    significance: float = 1e-3
    """Of the χ² tests: one false alarm in a thousand campaigns."""
    corroborated: float = 0.05
    """Significance of the total χ² if residuals are also correlated within groups."""
    negligible: float = 1.03
    """χ² per degree of freedom below which a lack of fit is ignored."""
    model_error: float = 0.002
    """Fraction of the explained χ² that small errors of the forward model leave,"""
    model_noise: float = 1.2
    """limited to this multiple of the noise."""
    enough: int = 60
    """Least number of readings to test the means of groups."""
    sure: float = 1e9
    """Degrees of freedom of a noise that is known."""
    observable: float = 0.05
    """Least fraction of the mean of a group that the fit leaves."""
    missed: float = 2.0
    """χ² per line of a response from which no effect is certain: resonances beside the measured
    ones, which any set of effects follows in part."""


TESTS = FitTestSettings()


@dataclass(frozen=True)
class PriorSettings:
    """Priors of the sizes of effects."""

    sparse: float = 1.0 / 3.0
    """Of the weight of an effect: those of its parameters of which some are zero; without it a
    bearing that only tilts loses to a drive."""
    finer: int = 4
    """Times as many sizes of many errors, which together show their size more exactly."""
    absent: float = 1e-6
    """Times its unit: what a parameter that is zero may still be."""
    same: float = 1e-6
    """Ln of the ratio of two sizes that are one: rounding."""
    apart: int = 3
    """Most parameters of which any may be zero; of more, subsets would be too many."""


PRIORS = PriorSettings()


@dataclass(frozen=True)
class PlausibilitySettings:
    """When a value is beyond its plausible range."""

    significant: float = 3.0
    """Standard deviations: least significant deviation from the range."""
    sensible: float = 3.0
    """Times the range: largest uncertainty of a parameter that says anything."""


PLAUSIBLE = PlausibilitySettings()
