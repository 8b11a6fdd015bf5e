autocmd BufRead,BufNewFile *.krd setfiletype koord
