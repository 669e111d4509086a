"""How the weights that come with tmca are made; ``train`` says how to run it."""
