# koord with what simulates worlds, makes machine code and plots:
#   docker build -t koord . && docker run --rm -v "$PWD:/work" koord verify posts.krd
# EXTRAS says what is installed of koord[…].
FROM python:3.12-slim AS build
ARG EXTRAS=fast,plot,record,sim
WORKDIR /source
COPY pyproject.toml README.md LICENSE ./
COPY koord koord
RUN python -m venv /opt/koord && \
    /opt/koord/bin/pip install --no-cache-dir ".[${EXTRAS}]"

FROM python:3.12-slim
COPY --from=build /opt/koord /opt/koord
ENV PATH="/opt/koord/bin:$PATH"
RUN useradd --create-home --uid 1000 koord
USER 1000
WORKDIR /work
ENTRYPOINT ["koord"]
CMD ["--help"]
