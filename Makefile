# `make` lists the targets. Each makes what it needs, once.

ROS_DISTRO ?= jazzy
export ROS_DISTRO

.DEFAULT_GOAL := help

.PHONY: help
help: ## List the targets
	@awk -F ':.*## ' '/^[a-z_]+:.*## / {printf "  make %-8s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

.PHONY: venv
venv: ## Make the environment: ROS 2 and the libraries (ROS_DISTRO=jazzy or kilted, or a sourced ROS 2)
	@scripts/setup_venv

.PHONY: build
build: venv ## Build the messages and link the package into install/
	@scripts/in_env scripts/build_workspace
