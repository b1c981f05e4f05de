"""The physics of a scene, written from textbooks. Shares no code and no data with the program that it checks."""
