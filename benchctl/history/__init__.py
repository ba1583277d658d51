"""Units over time: campaigns in a folder or an archive, indexed, charted and compared."""
