"""Rules of a fit for its pairs and lenses, and for cutting its work: the words that requests choose from."""

from __future__ import annotations

from typing import Literal

Loss = Literal["mean", "saturating"]
OutlierRule = Literal["keep", "exclude"]
# What pairs weigh by; `auto` is by their covariances where all state them.
Weights = Literal["equal", "covariances"]
WeightRule = Literal["auto", "equal", "covariances"]
# How a fit uses a stated lens; `free` only compares with it, `auto` locks it if the pairs are too few to refine it.
LensUse = Literal["auto", "free", "bounds", "prior", "locked"]
# Where a result's lens comes from.
LensOrigin = Literal["fitted", "stated", "stated, refined"]
Farm = Literal["auto", "slots", "runs"]
