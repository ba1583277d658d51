"""Another lab's bench: open recordings whose concealed physics is known, for tests of the diagnosis.

It shares no code with `instruments` nor with the diagnosis. What its motion, its climate and its noise look like was
measured on the open recordings of a bench that is not ours; the sizes of the effects are those of believable units.

`draw` draws what a recording hides, `make` makes it, `to_recording` opens it in memory, `write` writes the folder.
"""

from tests.benchctl.diagnosis.foreign.draw import KINDS, draw
from tests.benchctl.diagnosis.foreign.folder import to_recording, write
from tests.benchctl.diagnosis.foreign.make import make
from tests.benchctl.diagnosis.foreign.truth import Truth

__all__ = ["KINDS", "Truth", "draw", "make", "to_recording", "write"]
