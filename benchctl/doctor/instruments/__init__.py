"""The instruments themselves: who answers, who else does, and who does not."""
