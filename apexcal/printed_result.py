"""A fit's result that prints as what a person acts on."""

from __future__ import annotations

from apexcal.documents.checks import verdict_of
from apexcal.documents.results import FitResult

_GRAVITY = ("stop", "look")


class PrintedResult(FitResult):
    """A fit's result. ``print`` shows it in five lines: verdict, mount, lens, errors, and the gravest doubt."""

    def __str__(self) -> str:
        """Five lines; metres, degrees and pixels."""
        doubts = sorted(
            (each for each in self.checks if each.is_doubt), key=lambda each: _GRAVITY.index(each.verdict)
        )
        passed = sum(each.verdict == "pass" for each in self.checks)
        translation = ", ".join(f"{value:.4f}" for value in self.transform.translation_m)
        euler = self.transform.rotation.euler[0]
        angles = ", ".join(f"{value:.3f}" for value in euler.angles_deg)
        lens = ", ".join(f"{name} {value:.6g}" for name, value in self.intrinsics.by_name().items())
        fitted = self.kept
        doubt = f"{doubts[0].verdict}: {doubts[0].sentence} {doubts[0].remedy}".rstrip() if doubts else "No doubt."
        verdict = verdict_of(self.checks, "mount_with_lens")
        return "\n".join(
            (
                f"{self.model}: {verdict}; {passed} checks pass, {len(doubts)} do not",
                f"mount (camera from LiDAR): {translation} m; {euler.euler_order} {angles} degrees",
                f"lens: {lens}",
                f"errors: {fitted.mean_px:.2f} px mean, {fitted.rms_px:.2f} px RMS "
                f"of {fitted.pairs} of {self.pairs} pairs",
                doubt.replace("\n", " "),
            )
        )
