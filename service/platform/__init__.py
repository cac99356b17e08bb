"""The ground below every resource: database, storage, jobs, broker, HTTP, access, events, health and settings."""
