"""The live page, in a real browser, in front of a real server and real campaigns."""
