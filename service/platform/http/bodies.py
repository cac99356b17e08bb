"""How large a request's body may be, where a route says nothing else and where it takes more.

A route that takes more says so with ``max_body_size``. A declared length beyond it is answered 413 before a byte is
read, and a body without one is cut off there. Bodies up to :data:`DOCUMENT` are parsed on the event loop: the worst
of that length, a quarter of a million brackets, blocks it for 10 to 20 ms.
"""

from __future__ import annotations

KIB = 1024

# Names, answers to marking tasks, calibrations: the largest of them, with 16 lenses, has some 20 KiB.
DEFAULT = 64 * KIB
# Rigs of 16 cameras with 240 transforms, regions of many polygons, requests for 5,000 vehicles (200 KB).
DOCUMENT = 256 * KIB
# A sign-in link has at most 1,000 letters.
SIGN_IN = 4 * KIB
