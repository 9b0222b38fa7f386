"""Speed, measured in alternation with peers; and what becomes of jobs that are killed or find no room."""
