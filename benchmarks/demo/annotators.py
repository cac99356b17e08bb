"""Three people who mark vertices: each signs in by an invitation and works through the tasks, all at once."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from uuid import UUID

import numpy as np

from apexcal.client import Client
from apexcal.commands.session import OnProgress
from apexcal.documents.detections import DetectionView
from apexcal.documents.marking import Progress, Tally, TaskView
from benchmarks.demo.truth import Truth

NAMES = ("Ada", "Bo", "Chidi")
NOISE_PX = 1.0
# Each of them clicks another corner now and then, or the tip of a shadow.
BLUNDERS = 0.01
_BLUNDER_PX = (15.0, 40.0)
# A vertex this far from the board's real one is something else; people see that and reject it.
_ELSEWHERE_M = 0.35


def mark_everything(
    owner: Client, fleet_id: UUID, detection: DetectionView, camera: str, truth: Truth, report: OnProgress
) -> tuple[Progress, Tally]:
    """Invite three annotators, let them work at the same time; return the marking's progress and tally at the end."""
    invitations = [owner.fleets.invite(fleet_id, name, "annotator") for name in NAMES]
    counter = _Counter(len(NAMES) * (detection.counts.paired or 0), report)
    with ThreadPoolExecutor(len(NAMES)) as pool:
        work = [
            pool.submit(_work, invitation.link, owner.base_url, detection.id, camera, truth, number, counter)
            for number, invitation in enumerate(invitations)
        ]
        for each in work:
            each.result()
    return owner.marking.progress(detection.id, camera), owner.marking.tally(detection.id, camera)


def _work(
    link: str, base_url: str, detection_id: UUID, camera: str, truth: Truth, number: int, counter: _Counter
) -> None:
    with Client.sign_in(link, base_url) as person:
        while task := person.marking.next_task(detection_id, camera):
            mark = _look(task, truth, np.random.default_rng([number, task.vertex.sweep_index]))
            if mark is None:
                person.marking.answer(task.task_id, "rejected")
            else:
                person.marking.answer(task.task_id, "confirmed", u=mark[0], v=mark[1])
            counter.add()


def _look(task: TaskView, truth: Truth, random: np.random.Generator) -> tuple[float, float] | None:
    """Where this person clicks; None where the vertex is not the board's, or not in the image."""
    apex, pixel = truth.apex(task.frame.stamp_ns)
    vertex = np.array([task.vertex.x, task.vertex.y, task.vertex.z])
    if pixel is None or np.linalg.norm(vertex - apex) > _ELSEWHERE_M:
        return None
    mark = np.array(pixel) + random.normal(0.0, NOISE_PX, 2)
    if random.random() < BLUNDERS:
        turn = random.uniform(0.0, 2.0 * np.pi)
        mark = mark + random.uniform(*_BLUNDER_PX) * np.array([np.cos(turn), np.sin(turn)])
    last = np.array([task.frame.width - 1, task.frame.height - 1])
    u, v = np.clip(mark, 0.0, last).tolist()
    return u, v


class _Counter:
    """Answers so far, from several threads."""

    def __init__(self, total: int, report: OnProgress) -> None:
        self._total = max(total, 1)
        self._report = report
        self._done = 0
        self._lock = threading.Lock()

    def add(self) -> None:
        with self._lock:
            self._done += 1
            self._report(self._done / self._total, f"{self._done} answers by {len(NAMES)} people")
