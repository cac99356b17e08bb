"""Octave's `ga`, the nearest free relative of what the paper used: said by name, and not raced yet."""

import shutil

from benchmarks.solver.peers.contest import Peer, PeerMissingError

PEERS: list[Peer] = []

if shutil.which("octave-cli") is None and shutil.which("octave") is None:
    raise PeerMissingError("there is no octave command")
raise PeerMissingError("octave is here, but how to race its ga has not been written")
