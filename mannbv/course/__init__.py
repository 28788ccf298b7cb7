"""The course: explorers that a hand moves, checkers of exercises, grading of handed-in copies."""
