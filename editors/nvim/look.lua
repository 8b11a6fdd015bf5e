-- What Neovim shows of a program, as JSON; for a look, and for tests/editors/test_neovim.py:
--
--   KOORD_LOOK=out.json nvim --headless program.krd -c 'luafile editors/nvim/look.lua'
--
-- It waits for the verdicts on the program as it is, and on it with the line in KOORD_BREAK behind
-- it. Then the first lens is run, and what opens is noted. At last the mistakes of the configuration
-- in KOORD_CONFIGURATION. $KOORD_PATIENCE_MS is for each of these.
local patience = tonumber(vim.env.KOORD_PATIENCE_MS or "60000")
local buffer = vim.api.nvim_get_current_buf()
local space = vim.api.nvim_create_namespace("koord")
local done = {}

local function lenses()
  local found = {}
  for _, lens in ipairs(vim.lsp.codelens.get(buffer)) do
    table.insert(found, { line = lens.range.start.line + 1, title = lens.command.title })
  end
  return found
end

local function settled()
  local found = lenses()
  for _, lens in ipairs(found) do
    if lens.title:find("verifying") or lens.title:find("before the last change") then
      return false
    end
  end
  return #found > 0
end

local function shown()
  local signs, diagnostics = {}, {}
  for _, mark in ipairs(vim.api.nvim_buf_get_extmarks(buffer, space, 0, -1, { details = true })) do
    table.insert(signs, { line = mark[2] + 1, sign = vim.trim(mark[4].sign_text) })
  end
  for _, one in ipairs(vim.diagnostic.get(buffer)) do
    table.insert(diagnostics, { line = one.lnum + 1, code = one.code, message = one.message })
  end
  return { lenses = lenses(), signs = signs, diagnostics = diagnostics }
end

local function look()
  done.filetype = vim.bo[buffer].filetype
  done.syntax = vim.b[buffer].current_syntax
  done.settled = vim.wait(patience, settled, 50)
  done.first = shown()
  if vim.env.KOORD_BREAK then
    vim.api.nvim_buf_set_lines(buffer, -1, -1, false, { vim.env.KOORD_BREAK })
    local line = vim.api.nvim_buf_line_count(buffer)
    done.broken = vim.wait(patience, function()
      for _, lens in ipairs(lenses()) do
        if lens.line == line and lens.title:find("show the run") then
          return settled()
        end
      end
      return false
    end, 50)
    done.second = shown()
    vim.api.nvim_win_set_cursor(0, { line, 0 })
    vim.lsp.codelens.run()
    vim.wait(patience, function()
      return vim.api.nvim_get_current_buf() ~= buffer
    end, 50)
    done.opened = vim.api.nvim_buf_get_lines(0, 0, -1, false)
  end
  if vim.env.KOORD_CONFIGURATION then
    vim.cmd("edit! " .. vim.fn.fnameescape(vim.env.KOORD_CONFIGURATION))
    buffer = vim.api.nvim_get_current_buf()
    vim.wait(patience, function()
      return #vim.diagnostic.get(buffer) > 0
    end, 50)
    done.configuration = shown().diagnostics
  end
end

local went, reason = pcall(look)
done.errors = went and vim.v.errmsg or reason
vim.fn.writefile({ vim.json.encode(done) }, vim.env.KOORD_LOOK)
vim.cmd("qa!")
