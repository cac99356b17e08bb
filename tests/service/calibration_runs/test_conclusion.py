"""What a calibration ends as, and what of it a vehicle is given."""

from types import SimpleNamespace

import numpy as np
import pytest
from sqlalchemy import insert, select, update

from service.calibration_runs.actions import end_run
from service.calibration_runs.camera_summary import recommend
from service.calibration_runs.conclusion import conclude, runs_of
from service.db.calibrations import FULL
from service.db.models import Calibration, CalibrationRun, Publication, Result
from tests.service.jobs.support import make_calibration, statements

FREE = {"pinhole": 10, "brown_conrady": 16, "kannala_brandt": 14}


def document(mean_px, heldout=(), model="pinhole", **more):
    stage = {"mean_px": mean_px, "rms_px": mean_px}
    return {
        "ga": stage,
        "polished": stage,
        "baseline": stage,
        "status": "ok",
        "message": "Stopped.",
        "free_parameters": FREE[model],
        "at_bounds": [],
        "several_optima": [],
        "intrinsics": {
            "model": model,
            "image_size": [1280, 960],
            "f_x": 600.0,
            "f_y": 600.0,
            "c_x": 640.0,
            "c_y": 480.0,
        },
        "transform": {"rotation": {"matrix": np.eye(3).tolist()}, "translation_m": [0.0, 0.0, 0.0]},
        "residuals_px": [mean_px] * 20,
        "pairs": 20,
        "iterations": 1,
        "stopped": "converged",
        "alarms": [],
        "heldout": {"errors_px": list(heldout), "indices": list(range(len(heldout)))},
        **more,
    }


def end(database, run_id, state="done", found=None):
    with database.writing() as session:
        run = session.get_one(CalibrationRun, run_id)
        if found:
            session.add(
                Result(
                    fleet_id=run.fleet_id,
                    calibration_id=run.calibration_id,
                    run_id=run.id,
                    camera=run.camera,
                    model=run.model,
                    fold=run.fold,
                    document=found,
                )
            )
        end_run(session, run, state)


@pytest.fixture
def three_runs(database):
    """Full fits of two models, and one fold of the first."""
    calibration_id, runs = make_calibration(database, models=("pinhole", "brown_conrady", "kannala_brandt"))
    with database.writing() as session:
        session.get_one(Calibration, calibration_id).publish = "recommended"
        session.execute(update(CalibrationRun).where(CalibrationRun.id == runs[2]).values(model="pinhole", fold=0))
    return calibration_id, runs


def ended(database, calibration_id):
    with database.reading() as session:
        row = session.get_one(Calibration, calibration_id)
        return row.state, row.summary, session.scalars(select(Publication.result_id)).all()


def test_a_cancelled_calibration_keeps_what_it_found_and_publishes_nothing(database, three_runs):
    calibration_id, (pinhole, brown, fold) = three_runs
    end(database, pinhole, found=document(5.0))
    end(database, brown, found=document(1.0, model="brown_conrady"))
    end(database, fold, "cancelled")
    state, summary, published = ended(database, calibration_id)
    assert state == "cancelled"
    assert set(summary["cameras"]["front"]["models"]) == {"pinhole", "brown_conrady"}
    assert published == []


def test_a_calibration_of_one_run_ends_in_eight_statements(database):
    _, (run_id,) = make_calibration(database)
    with database.writing() as session:
        run = session.get_one(CalibrationRun, run_id)
        made_of = {name: getattr(run, name) for name in ("fleet_id", "calibration_id", "camera", "model", "fold")}
        session.execute(insert(Result).values(run_id=run_id, document=document(1.0), **made_of))
        with statements(database) as seen:
            end_run(session, run, "done")
            session.flush()
    # The run and the count; the calibration, its runs, results and slots; the calibration and its fleet request.
    assert seen == ["UPDATE"] * 2 + ["SELECT"] * 4 + ["UPDATE"] * 2


def test_a_model_of_which_nothing_was_held_out_is_not_judged(database, three_runs):
    calibration_id, (pinhole, brown, fold) = three_runs
    end(database, pinhole, found=document(5.0))
    end(database, brown, found=document(1.0, model="brown_conrady"))
    end(database, fold, found=document(5.0, [5.0, 6.0]))
    state, summary, _ = ended(database, calibration_id)
    assert state == "done"
    assert summary["cameras"]["front"]["recommended"] == "pinhole"
    assert "brown_conrady was not judged: nothing was held out of it." in summary["cameras"]["front"]["why"]


def test_a_fold_that_failed_or_left_parameters_open_counts_for_no_model(database):
    calibration_id, runs = two_models(database, folds=3)
    end_model(database, [runs["pinhole"][0]], 1.0, "pinhole")
    end_model(database, [runs["brown_conrady"][0]], 1.0, "brown_conrady")
    for fold in range(3):
        for model in ("pinhole", "brown_conrady"):
            found = document(1.0, model=model)
            wild = fold == 1 and model == "brown_conrady"
            found |= {"heldout": {"errors_px": [900.0 if wild else 1.0] * 10, "indices": range_of(fold)}}
            found |= {"status": "not_determined"} if wild else {}
            end(database, runs[model][1 + fold], found=found)
    _, summary, _ = ended(database, calibration_id)
    models = summary["cameras"]["front"]["models"]
    assert models["brown_conrady"]["heldout_mean_px"] == pytest.approx(1.0)
    assert models["brown_conrady"]["weight"] == pytest.approx(0.5)


def test_a_projection_that_is_none_costs_a_bounded_error(database):
    calibration_id, runs = two_models(database)
    for model, (full, *folds) in runs.items():
        end(database, full, found=document(1.0, model=model))
        for fold, run_id in enumerate(folds):
            errors = [1.0] * 9 + [2300.0 if (fold, model) == (0, "brown_conrady") else 1.0]
            end(
                database,
                run_id,
                found=document(1.0, errors, model=model)
                | {"heldout": {"errors_px": errors, "indices": range_of(fold)}},
            )
    _, summary, _ = ended(database, calibration_id)
    brown = summary["cameras"]["front"]["models"]["brown_conrady"]
    assert brown["heldout_forbidden"] == 1
    # A hundredth of the image's diagonal of 1600 px.
    assert brown["heldout_mean_px"] == pytest.approx((19 * 1.0 + 16.0) / 20)
    assert brown["behind"]["log_likelihood"] < 25.0


def two_models(database, *, folds=2):
    """Full fits of two models and their folds, to be published where recommended: (calibration, run ids by model)."""
    names = ["pinhole", "brown_conrady"]
    calibration_id, runs = make_calibration(database, models=[*names, *(f"{i}" for i in range(2 * folds))])
    by_model = {name: [run] for name, run in zip(names, runs, strict=False)}
    with database.writing() as session:
        session.get_one(Calibration, calibration_id).publish = "recommended"
        for place, run_id in enumerate(runs[2:]):
            model, fold = names[place % 2], place // 2
            session.execute(update(CalibrationRun).where(CalibrationRun.id == run_id).values(model=model, fold=fold))
            by_model[model].append(run_id)
    return calibration_id, by_model


def end_model(database, runs, mean_px, model, **more):
    """Its fit to all pairs, and in each fold 10 pairs whose errors lie a little about the mean."""
    end(database, runs[0], found=document(mean_px, model=model, **more))
    for fold, run_id in enumerate(runs[1:]):
        errors = [mean_px + 0.01 * (pair % 2) + 0.01 * fold for pair in range(10)]
        found = document(mean_px, model=model)
        end(database, run_id, found=found | {"heldout": {"errors_px": errors, "indices": range_of(fold)}})


def range_of(fold, count=10):
    return list(range(count * fold, count * fold + count))


@pytest.mark.parametrize(("folds", "given"), [(2, 1), (0, 0)])
def test_the_lowest_error_is_recommended_and_published_where_pairs_were_held_out(database, folds, given):
    calibration_id, runs = two_models(database, folds=folds)
    end_model(database, runs["pinhole"], 5.0, "pinhole")
    end_model(database, runs["brown_conrady"], 1.0, "brown_conrady")
    state, summary, published = ended(database, calibration_id)
    front = summary["cameras"]["front"]
    assert (state, front["recommended"]) == ("done", "brown_conrady")
    assert len(published) == given
    assert front["published"] is bool(given)
    assert front["not_published"] == ([] if given else ["No pairs were held out to judge it by."])


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ({"at_bounds": ["f_x", "k1"]}, "edge of its bounds (f_x, k1)"),
        ({"status": "not_determined", "message": "The points lie in one plane."}, "not_determined: The points lie"),
        ({"several_optima": ["The slots of the last iteration disagree."]}, "slots of the last iteration disagree"),
    ],
)
def test_what_a_person_should_look_at_first_does_not_publish_itself(database, more, says):
    calibration_id, runs = two_models(database)
    end_model(database, runs["pinhole"], 5.0, "pinhole", **({} if "status" in more else {"at_bounds": ["c_x"]}))
    end_model(database, runs["brown_conrady"], 1.0, "brown_conrady", **more)
    _, summary, published = ended(database, calibration_id)
    front = summary["cameras"]["front"]
    assert published == [] and front["published"] is False
    assert len(front["not_published"]) == 1 and says in front["not_published"][0]


def test_what_speaks_against_each_result_is_kept_also_where_nobody_asked_to_publish(database):
    calibration_id, runs = two_models(database)
    with database.writing() as session:
        session.get_one(Calibration, calibration_id).publish = "none"
    end_model(database, runs["pinhole"], 5.0, "pinhole")
    end_model(database, runs["brown_conrady"], 1.0, "brown_conrady", at_bounds=["k1"])
    _, summary, published = ended(database, calibration_id)
    front = summary["cameras"]["front"]
    assert published == [] and "not_published" not in front
    (edge,) = front["models"]["brown_conrady"]["objections"]
    (other,) = front["models"]["pinhole"]["objections"]
    assert edge == "brown_conrady lies on the edge of its bounds (k1): widen them, or lock what is known."
    assert other.startswith(
        "brown_conrady is recommended, not pinhole. Held-out pairs are likeliest under brown_conrady"
    )


def test_what_fits_far_better_than_it_foretells_does_not_publish_itself(database):
    calibration_id, runs = two_models(database)
    end_model(database, runs["pinhole"], 5.0, "pinhole")
    end_model(database, runs["brown_conrady"], 1.0, "brown_conrady", polished={"mean_px": 0.3, "rms_px": 0.3})
    _, summary, published = ended(database, calibration_id)
    assert published == []
    assert summary["cameras"]["front"]["not_published"][0].startswith("Held-out pairs lie 1.01 px off, the fitted")


@pytest.mark.parametrize(("before_px", "takes_over"), [(1.2, True), (0.6, False)])
def test_a_result_that_foretells_worse_than_the_current_one_does_not_publish_itself(database, before_px, takes_over):
    calibration_id, runs = two_models(database)
    with database.writing() as session:
        calibration = session.get_one(Calibration, calibration_id)
        of_vehicle = {"fleet_id": calibration.fleet_id, "vehicle_id": calibration.vehicle_id}
        had = {"cameras": {"front": {"models": {"pinhole": {"heldout_mean_px": before_px}}}}}
        before = Calibration(
            **of_vehicle, rig_id=calibration.rig_id, request={}, content_hash="1", state="done", remaining=0,
            publish="none", summary=had,
        )  # fmt: skip
        session.add(before)
        session.flush()
        run = session.get_one(CalibrationRun, runs["pinhole"][0])
        of_before = CalibrationRun(
            fleet_id=run.fleet_id, calibration_id=before.id, set_id=run.set_id, camera="front", model="pinhole",
            fold=-1, farm="runs", slots=1, bundle=1, problem={}, state="done",
        )  # fmt: skip
        session.add(of_before)
        session.flush()
        given = Result(
            fleet_id=run.fleet_id, calibration_id=before.id, run_id=of_before.id, camera="front", model="pinhole",
            fold=-1, document=document(before_px),
        )  # fmt: skip
        session.add(given)
        session.flush()
        session.add(Publication(**of_vehicle, camera="front", alias="current", number=1, result_id=given.id))
    end_model(database, runs["pinhole"], 5.0, "pinhole")
    end_model(database, runs["brown_conrady"], 1.0, "brown_conrady")
    _, summary, _ = ended(database, calibration_id)
    front = summary["cameras"]["front"]
    assert front["published"] is takes_over
    assert takes_over or front["not_published"] == [
        f"Held-out pairs lie 1.01 px off; of the vehicle's current result {before_px:.2f}."
    ]


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ({"marks_outside": 26}, "26 of 20 marks lie outside of the image"),
        (
            {"explained_px": 0.1},
            "what is stated of marks and vertices explains 0.1",
        ),
    ],
)
def test_what_marks_and_vertices_do_not_explain_does_not_publish_itself(database, more, says):
    calibration_id, runs = two_models(database)
    end_model(database, runs["pinhole"], 5.0, "pinhole")
    end_model(database, runs["brown_conrady"], 1.0, "brown_conrady", **more)
    _, summary, published = ended(database, calibration_id)
    assert published == []
    (reason,) = summary["cameras"]["front"]["not_published"]
    assert says in reason


def test_pairs_that_every_fit_left_out_are_not_held_against_any_model(database):
    calibration_id, runs = two_models(database)
    excluded = {"pinhole": (3, 4), "brown_conrady": (4,)}
    for model, (full, *folds) in runs.items():
        outliers = [{"index": index, "excluded": True} for index in excluded[model]]
        end(database, full, found=document(1.0, model=model, outliers=outliers))
        for fold, run_id in enumerate(folds):
            errors = [1.0] * 3 + [9.0, 500.0] if fold == 0 else [1.0] * 5
            found = document(1.0, model=model)
            end(database, run_id, found=found | {"heldout": {"errors_px": errors, "indices": range_of(fold, 5)}})
    _, summary, published = ended(database, calibration_id)
    models = summary["cameras"]["front"]["models"]
    assert [models[name]["heldout_pairs"] for name in runs] == [9, 9]
    assert models["brown_conrady"]["heldout_mean_px"] == pytest.approx((8 * 1.0 + 9.0) / 9)
    assert len(published) == 1


def test_the_alarm_of_a_rig_keeps_back_the_cameras_that_it_names(database):
    calibration_id, runs = two_models(database)
    rig = {"pairs": [{"cameras": ["front", "left"], "alarms": ["T_front_left lies 3 degrees off."]}]}
    end_model(database, runs["pinhole"][:-1], 1.0, "pinhole")
    end_model(database, runs["brown_conrady"], 5.0, "brown_conrady")
    last = runs["pinhole"][-1]
    end(database, last, found=document(1.0) | {"heldout": {"errors_px": [1.0] * 10, "indices": range_of(1)}})
    with database.writing() as session:
        session.query(Publication).delete()
        conclude(session, session.get_one(Calibration, calibration_id), runs_of(session, calibration_id), rig=rig)
    _, summary, published = ended(database, calibration_id)
    assert published == []
    assert summary["cameras"]["front"]["not_published"] == rig["pairs"][0]["alarms"]
    assert summary["rig"] == rig


def test_folds_that_two_versions_cut_differently_are_judged_by_what_all_models_held_out():
    """During a rolling upgrade a fold of the older cut and one of ours may hold out the same pair."""

    def found(model, fold, indices):
        heldout = {"errors_px": [1.0] * len(indices), "indices": indices}
        return SimpleNamespace(model=model, fold=fold, document=document(1.0, model=model) | {"heldout": heldout})

    cut = {"pinhole": ([0, 1, 2, 3], [2, 3, 4]), "brown_conrady": ([0, 2, 4], [1, 3])}
    results = [found(model, fold, held) for model, folds in cut.items() for fold, held in enumerate(folds)]
    results += [found(model, FULL, []) for model in cut]
    choice, candidates = recommend(results)
    assert choice.recommended == "pinhole"
    assert [one.heldout.number.tolist() for one in candidates.values()] == [[0, 1, 2, 3, 4], [0, 1, 2, 3, 4]]
