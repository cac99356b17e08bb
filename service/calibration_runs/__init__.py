"""How a calibration moves: its runs, the fan-in, the conclusion and what a fleet request hears of it."""
