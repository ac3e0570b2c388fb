"""The elastic network of a mechanism and its condensation to the tool."""
