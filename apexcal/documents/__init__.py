"""The ground floor: what goes over the wire, defined once for the client, the service and the workers.

Nothing here imports anything else of ours.
"""
