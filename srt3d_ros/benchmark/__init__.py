"""`srt3d benchmark`: what the SRT3D paper times, timed here: one part a module, one line of JSON a measurement."""
