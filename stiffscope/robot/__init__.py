"""The robot file: its keys, its values in SI, its parts and the elastic robot that it describes."""
