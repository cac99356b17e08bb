"""What ``refined`` offers: its options, and its reasons to give no vertex."""

from __future__ import annotations

from typing import Final

from workers.vertices.options import number_options

OPTIONS: Final = number_options(
    board_width_m=("number", 0.0, 0.0, 3.0, "one edge of the board in metres; 0: estimated from near sweeps"),
    board_height_m=("number", 0.0, 0.0, 3.0, "the other edge in metres; 0: estimated from near sweeps"),
    edge_growth_mrad=(
        "number",
        -1.0,
        -1.0,
        10.0,
        "how far outside the board's edges a beam still returns from it, in milliradians (half the width of the "
        "beam, or less); -1: estimated from near sweeps",
    ),
    track=(
        "integer",
        1,
        0,
        1,
        "1: the sweeps before and after tell the board's roll and outliers; 0: each for itself",
    ),
    max_sigma_deg=(
        "number",
        0.15,
        0.005,
        2.0,
        "largest standard deviation of an accepted vertex in degrees, azimuth and elevation together",
    ),
)

REASONS: Final = {
    "no_points": "no point of the sweep lies in the region",
    "too_few_rings": "fewer than two rings meet anything in the region that could be the board",
    "not_a_board": "nothing in the region is flat and ends in a right-angled corner at the top",
    "too_uncertain": "the rays that meet and miss the board do not determine its apex well enough",
    "off_the_track": "the vertex lies far off the path of the sweeps before and after",
}
