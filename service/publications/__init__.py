"""Publications: where the aliases of a camera lead, and what a vehicle is given."""
