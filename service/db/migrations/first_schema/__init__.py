"""The tables of the first migration, by subject and in the order in which they refer to each other."""
