"""Speed, measured in alternation with peers."""
