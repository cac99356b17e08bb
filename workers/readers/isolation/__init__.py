"""What a process that reads uploads may reach: its recording, its folders, and nothing else."""
