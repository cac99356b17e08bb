"""How often the solver ends on the optimum, and whether its error bars are honest."""
