"""Pictures of clouds, drawn without a screen. matplotlib and Pillow only here."""
