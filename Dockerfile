# Runs README's two commands: `docker build -t stiffscope .` sets up, `docker run stiffscope` computes the Biglide,
# `docker run stiffscope python -m pytest -n auto` runs the tests.
FROM python:3.12-slim
RUN apt-get update && apt-get install -y --no-install-recommends libegl1 libgl1-mesa-dri && rm -rf /var/lib/apt/lists/*
WORKDIR /stiffscope
COPY . .
RUN python -m pip install -q -c constraints.txt -e '.[dev]'
CMD ["stiffscope", "run", "biglide", "--out", "out"]
