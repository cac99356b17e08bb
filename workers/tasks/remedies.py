"""Remedies of a result's checks, tried on its own pairs: what each would bring on pairs that are held out.

A remedy is a few members of the run's request, or of its pairs, that are changed as its sentence says. Both fits
hold the same pairs out, and are compared as models are (`workers.models.choice`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sqlalchemy.orm import Session

from apexcal.documents.camera_models import DEFAULT_MODELS
from apexcal.documents.checks import doubts_of, figure, verdict_of
from apexcal.documents.errors import DocumentError
from apexcal.documents.pairs import VELOCITY
from apexcal.documents.remedies import RemedyTrial, TrialOutcome, TriedRemedies
from apexcal.documents.results import FitResult
from apexcal.geometry.se3 import from_document
from service.platform.db.analyses import Analysis
from service.platform.db.base import Json
from service.platform.db.calibrations import FULL, CalibrationRun, Result
from service.platform.jobs.claims import Claim, Lease
from workers.geometry.models import INTRINSICS, parse_model
from workers.geometry.projection import project
from workers.judge.causes import CLOCK, LENS, SHUTTER, Finding, find_causes
from workers.judge.fit_checks import without_outliers
from workers.judge.lens_checks import worst_prior
from workers.models.choice import Candidate, choose
from workers.models.summary import candidate_of
from workers.solver.estimate import Estimate, estimate
from workers.solver.narrowing import SearchState, run_search
from workers.solver.narrowing import from_document as state_of
from workers.solver.outcomes import NEVER, SolveError, Stop
from workers.tasks.context import Context
from workers.tasks.run_inputs import read_run
from workers.tasks.solving import solved

_FOLDS: Final = 5  # where the calibration held nothing out
_SURE: Final = 2.0  # standard errors of a difference on held-out pairs
_MIDDLE: Final = 0.95
_TRIED: Final = {CLOCK, SHUTTER, LENS, "priors", "wrong_pairs", "stated_lens", "coverage"}


class Remedy(NamedTuple):
    """One remedy of a check: what it does, in words, and the request and pairs of the run with it."""

    check: str
    words: str
    document: Json
    columns: Json


class Fits(NamedTuple):
    """A fit to all pairs, and those that hold out one part of them each."""

    whole: FitResult
    folds: Mapping[int, FitResult]


def remedies(context: Context, claim: Claim, lease: Lease) -> Callable[[Session], Json]:
    """Try the remedies of a result's checks."""
    with context.database.reading() as session:
        result = session.get_one(Result, session.get_one(Analysis, claim.subject_id).result_id)
        run = session.get_one(CalibrationRun, result.run_id)
        document, search, set_id, fit = run.fit_request, run.search_state, run.set_id, result.fit
    pairs = context.pairs_of(set_id)
    lease.report(0.0, "trying what the checks advise")
    state = state_of(search) if search else run_search(read_run(document, FULL, pairs, lease).problem)
    answer: Json = tried(document, pairs, state, fit, lease).model_dump(mode="json")
    return lambda session: answer


def tried(document: Json, columns: Json, state: SearchState, result: FitResult, stop: Stop = NEVER) -> TriedRemedies:
    """Try the remedies of the result's checks that say `look` or `stop`.

    document and columns: the run's request and its set's pairs; state: the end of its search.
    """
    trials = [trial for _, trial in trials_of(document, columns, state, result, stop)]
    advice = next((trial.check for trial in trials if trial.outcome == "helps"), None)
    return TriedRemedies(trials=trials, advice=advice)


def trials_of(
    document: Json, columns: Json, state: SearchState, result: FitResult, stop: Stop = NEVER
) -> list[tuple[Remedy, RemedyTrial]]:
    """Each tried remedy with what it brings, the most helpful first."""
    doubtful = {check.name for check in doubts_of(result.checks)}
    if not doubtful & _TRIED:
        return []
    chosen = [each for each in _remedies(document, columns, state, result, doubtful) if each.check in doubtful]
    before = _fits(document, columns, state, stop, result) if chosen else None
    trials = [(each, _trial(each, before, state, stop)) for each in chosen if before]
    return sorted(trials, key=lambda each: -(each[1].log_likelihood or 0.0))


def applied(remedy: Remedy, model: str, state: SearchState, stop: Stop = NEVER) -> tuple[FitResult, SearchState]:
    """The fit to all pairs with a remedy, as a calibration would make it, and the end of its search.

    state: of the search for `model`, from which a fit of the same model starts.
    """
    run_input = read_run(remedy.document, FULL, remedy.columns, stop)
    if remedy.document["model"] != model:
        state = run_search(run_input.problem)
    return solved(run_input, state), state


def _remedies(
    document: Json, columns: Json, state: SearchState, result: FitResult, doubtful: Collection[str]
) -> Iterator[Remedy]:
    """All remedies that can be tried without new marks. A lens that is accused twice is freed once."""
    estimated = without_outliers(estimate(read_run(document, FULL, columns).problem, np.array(state.best_parameters)))
    causes = find_causes(estimated)
    if CLOCK in causes and np.isfinite(causes[CLOCK].test.deviations[0]):
        yield _with_clock(document, columns, estimated, causes[CLOCK])
    if SHUTTER in causes and np.isfinite(causes[SHUTTER].test.deviations[0]):
        line_us = result.line_time_us + float(causes[SHUTTER].test.values[0])
        words = f"With rows read {line_us:.0f} microseconds after each other"
        yield Remedy(SHUTTER, words, document | {"line_time_us": line_us}, columns)
    prior = worst_prior(estimated, causes)
    if prior is not None:
        rest = {name: value for name, value in document["priors"].items() if name != prior.name}
        unstated = [*document["unstated"], prior.name]
        words = f"Without the prior of {prior.name}"
        yield Remedy("priors", words, document | {"priors": rest, "unstated": unstated}, columns)
    if document["outliers"] != "exclude":
        yield Remedy("wrong_pairs", "Without the wrong marks", document | {"outliers": "exclude"}, columns)
    if result.lens != "fitted":
        check = "stated_lens" if "stated_lens" in doubtful else LENS
        yield Remedy(check, "With a lens of its own", _with_free_lens(document), columns)
        return
    if document["stated_lens"] and "model" in document["stated_lens"]:
        yield Remedy("coverage", "With the stated lens", _with_stated_lens(document), columns)
    for model in DEFAULT_MODELS:
        if model != document["model"]:
            free = _with_free_lens(document) | {"model": model, "unstated": list(INTRINSICS[model])}
            yield Remedy(LENS, f"With the lens model {model}", free, columns)


def _with_clock(document: Json, columns: Json, estimated: Estimate, finding: Finding) -> Remedy:
    """The pairs at the times that the clock's finding says, known as well as it is."""
    problem = read_run(document, FULL, columns).whole
    assert problem.velocities is not None
    fitted_s = -1e-3 * estimated.clock.offset_ms if estimated.clock else 0.0
    late_s, deviation_s = fitted_s + float(finding.test.values[0]), float(finding.test.deviations[0])
    points = np.column_stack([columns[name] for name in "xyz"]) + late_s * problem.velocities
    moved = dict(zip("xyz", points.T.tolist(), strict=True)) | {VELOCITY: problem.velocities.tolist()}
    errors = document["common_errors"] | {"clock_ms": 1e3 * deviation_s}
    words = f"With the clocks moved by {1e3 * abs(late_s):.1f} ms"
    return Remedy(CLOCK, words, document | {"common_errors": errors}, dict(columns) | moved)


def _with_free_lens(document: Json) -> Json:
    names = set(INTRINSICS[parse_model(document["model"])])
    rest: Json = {
        member: {name: value for name, value in document[member].items() if name not in names}
        for member in ("locked", "priors", "bounds")
    }
    return document | rest | {"unstated": sorted({*document["unstated"], *names} - document["bounds"].keys())}


def _with_stated_lens(document: Json) -> Json:
    lens = document["stated_lens"]
    model = parse_model(lens["model"])
    free = _with_free_lens(document)
    locked = free["locked"] | {name: float(lens[name]) for name in INTRINSICS[model]}
    return free | {"model": model, "locked": locked, "unstated": []}


def _fits(document: Json, columns: Json, state: SearchState, stop: Stop, whole: FitResult) -> Fits:
    count = document["folds"] or _FOLDS
    folds: dict[int, FitResult] = {}
    for fold in range(count):
        folded = document | {"folds": count, "fold": fold}
        try:
            folds[fold] = solved(read_run(folded, fold, columns, stop), state)
        except (SolveError, DocumentError):
            continue  # A fit that leaves parameters open cannot be compared.
    return Fits(whole, folds)


def _trial(remedy: Remedy, before: Fits, state: SearchState, stop: Stop) -> RemedyTrial:
    try:
        whole, state = applied(remedy, before.whole.model, state, stop)
        after = _fits(remedy.document, remedy.columns, state, stop, whole)
    except (SolveError, DocumentError) as error:
        return RemedyTrial(check=remedy.check, outcome="unknown", sentence=f"{remedy.words} no fit succeeds: {error}")
    candidates = {"before": candidate_of(*before), "after": candidate_of(*after)}
    if remedy.check == "wrong_pairs":
        # Whitened errors come from fits that left out wrong pairs already.
        candidates = {name: _as_fitted(each) for name, each in candidates.items()}
    width, height = whole.intrinsics.image_size
    choice = choose(candidates, float(width * height)) if all(each.heldout for each in candidates.values()) else None
    gap = choice and next(iter(choice.behind.items()), None)
    if choice is None or gap is None:
        sentence = f"{remedy.words} there is no verdict: too few pairs can be held out."
        return RemedyTrial(check=remedy.check, outcome="unknown", sentence=sentence)
    worse, behind = gap
    is_clear = not behind.within_noise and behind.log_likelihood > _SURE * behind.standard_error_log_likelihood
    outcome: TrialOutcome = "alike" if not is_clear else "helps" if worse == "before" else "harms"
    moved_px = _moved_px(remedy.columns, before.whole, whole)
    noise, noise_before = choice.sigma_px["after"], choice.sigma_px["before"]
    verdict = verdict_of(whole.checks, "mount_with_lens")
    digits = 2 if figure(noise) != figure(noise_before) else 3
    noises = f"{figure(noise, digits)} instead of {figure(noise_before, digits)} px"
    scatter = f"held-out pairs scatter by {noises} per coordinate"
    moves = "" if moved_px is None else f" Corners move by up to {figure(moved_px)} px."
    brings = {
        "helps": f"{remedy.words} the result is better: {scatter}.{moves} The fit's checks say {verdict}.",
        "alike": f"{remedy.words} nothing changes that shows: {scatter}.",
        "harms": f"{remedy.words} the result is worse: {scatter}.",
        "unknown": scatter,
    }
    return RemedyTrial(
        check=remedy.check,
        outcome=outcome,
        sentence=brings[outcome],
        noise_px=noise,
        noise_before_px=noise_before,
        log_likelihood=behind.log_likelihood if worse == "before" else -behind.log_likelihood,
        standard_error_log_likelihood=behind.standard_error_log_likelihood,
        moved_px=moved_px,
        verdict=verdict,
    )


def _as_fitted(candidate: Candidate) -> Candidate:
    """Return the candidate with plain errors (px) in place of whitened ones, wrong pairs included."""
    heldout = candidate.heldout
    if heldout is None:
        return candidate
    plain = replace(heldout, standard_px=heldout.errors_px, stretch=np.ones(len(heldout.errors_px)))
    return replace(candidate, heldout=plain)


def _moved_px(columns: Json, before: FitResult, after: FitResult) -> float | None:
    """Return how far corners move that both results project; None if there are none."""
    points = np.column_stack([columns[name] for name in "xyz"]).astype(np.float64)
    moved = np.hypot(*(_projected(before, points) - _projected(after, points)).T)
    moved = moved[np.isfinite(moved)]
    return float(np.quantile(moved, _MIDDLE)) if moved.size else None


def _projected(result: FitResult, points: NDArray[np.float64]) -> NDArray[np.float64]:
    lens: Any = result.intrinsics
    return project(parse_model(lens.model), lens.by_name(), from_document(result.transform).apply(points))[0]
