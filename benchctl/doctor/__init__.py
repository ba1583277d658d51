"""What may keep a bench from working, looked for on this machine and on its wires; every finding says what to do."""
