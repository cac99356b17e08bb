"""Where a genetic algorithm is worth having, and where plain least squares or a linear start do as well."""
