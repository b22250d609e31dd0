"""Published data: observers, metals, indices of refraction, media, skies."""
