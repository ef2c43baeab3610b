"""What is stored of rankings, searches and series of tests, and what follows from it."""
