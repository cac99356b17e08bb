"""The job table's protocol: enqueue, claim, renew, finish, reap."""
