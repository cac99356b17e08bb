"""Isolation of a process that reads uploads; it may reach its recording, its folders, and nothing else."""
