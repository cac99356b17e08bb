"""What the farm costs beside the work: whole calibrations, single trips, slots, and more workers than cores."""
