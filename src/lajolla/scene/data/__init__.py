"""What others measured or standardised: observers, metals, indices of refraction, media, skies."""
