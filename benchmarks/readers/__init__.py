"""Our readers of containers beside the libraries that read them too."""
