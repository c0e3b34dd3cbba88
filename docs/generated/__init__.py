"""What the site has beside its pages: tables made from the code, and notebooks."""
