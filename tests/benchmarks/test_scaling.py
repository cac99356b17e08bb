"""What is replayed and simulated of more processes than there are, beside cases that can be computed."""

from uuid import UUID

import pytest

from benchmarks.fleet.scaling import PROCESSES, SERVERS, scaled
from benchmarks.latency import DoneJob, replayed

_FIRST, _SECOND = UUID(int=1), UUID(int=2)


def test_jobs_of_a_run_wait_for_the_stage_before_and_other_runs_do_not():
    jobs = [
        DoneJob(_FIRST, 0, 3.0),
        DoneJob(_FIRST, 0, 1.0),
        DoneJob(_FIRST, 1, 2.0),
        DoneJob(_SECOND, 0, 1.0),
    ]
    assert replayed(jobs, 0.0, 1) == 7.0
    assert replayed(jobs, 0.0, 2) == 5.0
    assert replayed(jobs, 0.5, 100) == 6.0


@pytest.mark.parametrize("busiest", ["worker", "postgres", "broker"])
def test_the_simulation_comes_near_its_bound_and_names_what_is_busy(busiest):
    cost_s = dict.fromkeys((*SERVERS, "worker"), 1e-5) | {busiest: 0.1 if busiest == "worker" else 0.01}
    for scale in scaled(cost_s, 7):
        assert scale.busiest == busiest
        assert scale.simulated_per_s == pytest.approx(scale.bound_per_s, rel=0.15)
    limit = PROCESSES / cost_s["worker"] if busiest == "worker" else SERVERS[busiest] / cost_s[busiest]
    assert scale.bound_per_s <= 100 * limit
