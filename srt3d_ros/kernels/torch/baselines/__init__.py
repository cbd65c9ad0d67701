"""The gradient steps and the APSS denoiser of the published methods: torch."""
