"""Recommends the smallest camera model that held-out pairs do not reject, and says why.

The one-standard-error rule (Breiman and others 1984), paired: models are compared block by block on the same held-out
pairs, by the logarithm of the ratio of their mean errors. A lens that a model lacks costs a tenth of a pixel in one
part of the field and fifty in another; the ratio is what the blocks have in common (docs/decisions/0020).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import expm1, log, log1p, sqrt

# A gain below this share is not worth a larger model's parameters, however certain.
_HAIR = 0.02
# A model whose error is this many times the lowest is never within the noise: a single block that it misses gives
# a mean ratio of exactly its standard error, however far off it is there.
_FAR = 1.5
# Errors below this count as zero: only made-up pairs have them.
_NO_ERROR_PX = 1e-9


@dataclass(frozen=True)
class Candidate:
    """A model as it was fitted: its free parameters, its mean error on the fitted pairs, and those held out.

    ``heldout`` has the errors of each block by the pairs' indices, px.
    """

    free_parameters: int
    fitted_mean_px: float
    heldout: Mapping[int, Mapping[int, float]]

    @property
    def errors_px(self) -> dict[int, float]:
        """The held-out error of each pair."""
        return {pair: error for block in self.heldout.values() for pair, error in block.items()}


@dataclass(frozen=True)
class Difference:
    """How much higher a model's held-out error is than the lowest one: its mean over the pairs, and block by block.

    ``percent`` is the blocks' mean ratio; the standard errors are of the blocks, for pairs of one block share a fit.
    ``within_noise``: it is at most its standard error or 2 %, and the mean error is not far above the lowest.
    """

    px: float
    standard_error_px: float
    percent: float
    standard_error_percent: float
    within_noise: bool


@dataclass(frozen=True)
class Choice:
    """The recommended model or none, the sentences that say why, and each model's difference to the lowest."""

    recommended: str | None
    why: str
    behind: dict[str, Difference]


def choose(models: Mapping[str, Candidate]) -> Choice:
    """Recommend the model with the fewest free parameters within the noise of the lowest held-out error."""
    blocks = {name: {fold: frozenset(block) for fold, block in one.heldout.items()} for name, one in models.items()}
    first = next(iter(blocks.values()))
    if any(other != first for other in blocks.values()):
        return Choice(
            None,
            "The models cannot be compared: not the same pairs were held out of each (too few pairs for the larger "
            "models, or a run that failed). Ask again with more pairs, fewer folds or fewer models.",
            {},
        )
    return _by_heldout(models) if first else _by_fitted(models)


def _by_heldout(models: Mapping[str, Candidate]) -> Choice:
    means = {name: _mean(list(one.errors_px.values())) for name, one in models.items()}
    lowest = min(models, key=lambda name: (means[name], models[name].free_parameters, name))
    behind = {name: _difference(one, models[lowest]) for name, one in models.items() if name != lowest}
    smaller = [
        name
        for name, difference in behind.items()
        if difference.within_noise and models[name].free_parameters < models[lowest].free_parameters
    ]
    chosen = min(smaller, key=lambda name: (models[name].free_parameters, means[name], name), default=lowest)
    ranked = sorted(means, key=lambda name: (means[name], name))
    sentences = [f"{lowest} has the lowest mean error on held-out pairs: {means[lowest]:.2f} px"]
    sentences += [_behind(name, behind[name], lowest) for name in ranked if name != lowest]
    why = "; ".join(sentences) + "."
    if chosen != lowest:
        why += (
            f" Where that is all, the smaller model is recommended: {chosen}, with "
            f"{models[chosen].free_parameters} free parameters instead of {models[lowest].free_parameters}."
        )
    return Choice(chosen, why, behind)


def _by_fitted(models: Mapping[str, Candidate]) -> Choice:
    ranked = sorted(models, key=lambda name: (models[name].fitted_mean_px, models[name].free_parameters, name))
    lowest = models[ranked[0]].fitted_mean_px
    sentences = [f"{ranked[0]} has the lowest mean error on the fitted pairs: {lowest:.2f} px"]
    sentences += [f"{name} is {models[name].fitted_mean_px - lowest:.2f} px behind" for name in ranked[1:]]
    caution = " None were held out, and on the pairs that it was fitted to a larger model always looks better."
    return Choice(ranked[0], "; ".join(sentences) + "." + caution, {})


def _difference(model: Candidate, lowest: Candidate) -> Difference:
    base = lowest.errors_px
    blocks = [(list(block.values()), [base[pair] for pair in block]) for block in model.heldout.values()]
    count = sum(len(errors) for errors, _ in blocks)
    mean = sum(sum(errors) - sum(others) for errors, others in blocks) / count
    # Of the blocks' sums about their expectation (Liang and Zeger 1986, with the usual factor for few clusters).
    squares = sum((sum(errors) - sum(others) - mean * len(errors)) ** 2 for errors, others in blocks)
    of_mean = sqrt(squares * len(blocks) / max(len(blocks) - 1, 1)) / count
    ratios = [log(max(_mean(errors), _NO_ERROR_PX) / max(_mean(others), _NO_ERROR_PX)) for errors, others in blocks]
    ratio = _mean(ratios)
    of_ratio = sqrt(sum((one - ratio) ** 2 for one in ratios) / max(len(ratios) - 1, 1) / len(ratios))
    near = mean <= max((_FAR - 1.0) * _mean(list(base.values())), _NO_ERROR_PX)
    within_noise = near and ratio <= max(of_ratio, log1p(_HAIR))
    return Difference(mean, of_mean, 100.0 * expm1(ratio), 100.0 * expm1(of_ratio), within_noise)


def _behind(name: str, difference: Difference, lowest: str) -> str:
    sure = difference.percent > difference.standard_error_percent
    noise = "more than noise" if sure else "too far to be left to the noise of a few blocks"
    if difference.within_noise:
        noise = f"no more than {100 * _HAIR:g} %" if sure else "within the noise"
    return (
        f"{name} is {difference.px:.2f} ± {difference.standard_error_px:.2f} px behind {lowest} (block by block "
        f"{difference.percent:.1f} ± {difference.standard_error_percent:.1f} %), {noise}"
    )


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)
