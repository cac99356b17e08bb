"""An operator's commands beside the service: back up, restore, look after people, jobs and retention."""
