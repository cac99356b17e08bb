"""How often verdicts on calibrations are right."""
