"""Recordings of real instruments, made by others: what a diagnosis must say of them."""
