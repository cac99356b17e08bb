"""Python's garbage collector: it hardly ever searches the objects that the imports made."""

import atexit
import gc

_USUAL = gc.get_threshold()
# The imports make a quarter of a million objects that stay. To search them for garbage takes a tenth of the start.
gc.set_threshold(500_000, *_USUAL[1:])
# To search them when the process ends takes another tenth of every command.
atexit.register(gc.freeze)


def imports_done() -> None:
    """Collect garbage as often as Python does by default, but not among the objects that the imports made."""
    gc.freeze()
    gc.set_threshold(*_USUAL)
