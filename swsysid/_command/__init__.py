"""The main job from a recording: tables, samples, the identification and its text."""
