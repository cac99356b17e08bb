"""docker-compose.yml in real containers: `make compose-test`."""
