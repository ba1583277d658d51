"""The unexplained rest: where it lives, and whether a name may stand for it."""
