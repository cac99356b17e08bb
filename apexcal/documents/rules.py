"""How a fit treats its pairs and lenses, and how its work is cut: the words that requests choose from."""

from __future__ import annotations

from typing import Literal

Loss = Literal["mean", "saturating"]
OutlierRule = Literal["keep", "exclude"]
# What pairs weigh by; `auto` is by their covariances where all state them.
Weights = Literal["equal", "covariances"]
WeightRule = Literal["auto", "equal", "covariances"]
LensUse = Literal["bounds", "prior", "locked"]
Farm = Literal["auto", "slots", "runs"]
