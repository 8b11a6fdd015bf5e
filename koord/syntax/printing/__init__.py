"""From tree to text, in the one layout; core programs are made trees first."""
