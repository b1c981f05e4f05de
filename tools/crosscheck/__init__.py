"""An independent reference for the `era` program: own model, own search, own integration, compared through its public face."""
