"""The paper's two recordings, simulated: what the vertices, the clocks, the clicks and the model each add."""
