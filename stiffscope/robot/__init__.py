"""The robot file: what it may say, its values in SI, the parts and the elastic robot that it describes."""
