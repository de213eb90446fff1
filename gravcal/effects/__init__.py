"""Effects: what nature and instruments add, one object each."""
