"""Files: tables, recordings, descriptions of sensors and plans, maps, pictures."""
