"""The machine: what benchctl runs on, where recordings land, and what might end a weekend's campaign."""
