"""A recording as one MCAP file for viewers, with its calibration and with undistorted frames."""
