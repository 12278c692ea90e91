"""Many objects with one command, each as if it had been given alone: python -m recon.batch LIST --out DIR."""
