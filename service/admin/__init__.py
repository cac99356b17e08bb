"""What an operator does beside the service: back up, restore, look after people, jobs and retention."""
