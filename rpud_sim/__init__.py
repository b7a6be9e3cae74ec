"""A real-time simulator of a rotary-percussive ultrasonic drill."""
