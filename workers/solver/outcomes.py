"""How a minimisation ended: one enumeration for all of them."""

from enum import Enum


class Outcome(Enum):
    """The end of a minimisation; `sentence` says it to people."""

    CONVERGED = "converged"
    NO_STEP_LEFT = "no_step_left"
    NOTHING_FREE = "nothing_free"
    OUT_OF_STEPS = "out_of_steps"

    @property
    def sentence(self) -> str:
        """The outcome in one sentence."""
        return _SENTENCES[self]

    @property
    def converged(self) -> bool:
        """Whether the end is a minimum, so that its parameters may be used."""
        return self is not Outcome.OUT_OF_STEPS


_SENTENCES = {
    Outcome.CONVERGED: "The last step changed what is minimised by less than the tolerance.",
    Outcome.NO_STEP_LEFT: "No step, however short, lowers what is minimised.",
    Outcome.NOTHING_FREE: "Nothing is free to move.",
    Outcome.OUT_OF_STEPS: "The steps ran out before a minimum was reached.",
}
