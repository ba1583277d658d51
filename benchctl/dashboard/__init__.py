"""The live page: `data` reads campaigns, `web` serves what it finds, `page` shows it in a browser."""
