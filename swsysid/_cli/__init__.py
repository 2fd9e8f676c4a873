"""The main job from a recording: samples, the identification and its text."""
