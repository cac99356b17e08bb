"""The genetic algorithm's speed and its operators, measured."""
