"""Whether an effect keeps what every effect of the catalogue keeps: its file, its laws, its heat."""
