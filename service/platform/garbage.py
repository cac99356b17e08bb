"""When Python looks for garbage: hardly ever among what the imports made."""

import atexit
import gc

_USUAL = gc.get_threshold()
# The imports make a quarter of a million objects that stay. Looking for garbage among them is a tenth of the start.
gc.set_threshold(500_000, *_USUAL[1:])
# Nor among what ends with the process: that takes another tenth, of every command.
atexit.register(gc.freeze)


def imports_done() -> None:
    """Look for garbage as often as Python does by itself, and not among what the imports made."""
    gc.freeze()
    gc.set_threshold(*_USUAL)
