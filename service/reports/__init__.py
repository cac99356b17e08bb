"""Reports of results: a worker makes each as one HTML file."""
