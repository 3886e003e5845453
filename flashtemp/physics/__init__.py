"""What acts on a sliding rubber block: the contract of an effect, quantities, materials, closed forms."""
